"""The commands of `cosim`, a file each."""
