"""The Millard 2012 equilibrium muscle, vectorised over muscles; it needs numpy and nothing else."""
