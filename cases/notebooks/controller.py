# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A controller in the loop
#
# A finger presses on an object, and a controller holds the force of its fingertip by pulling on the
# extensor digitorum communis (EDC). Finger and hood are the plant: first as `cosim.couple`, which
# solves an equilibrium in some 20 ms, then as a Functional Mock-up Unit, as another simulator would
# load it. Writing the unit needs `pip install '.[fmu]'`.

# %%
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description

import cosim
from cosim.fmu_export.write import write_fmu

case = cosim.load("pulley_edc")
STEP, STEPS = 0.02, 60  # s
asked = np.where(np.arange(STEPS) < STEPS // 2, 0.25, 0.40)  # N, dorsal


# %% [markdown]
# The controller: proportional and integral, for a motor whose tension follows its command with a
# lag of 60 ms. A tendon cannot push, so the command is at least the resting tension.


# %%
class Controller:
    """Tension of EDC (N) for a dorsal force of the fingertip (N)."""

    proportional, integral = 12.0, 200.0  # N/N, N/(N s)
    lag, least, most = 0.06, 0.05, 20.0  # s, N, N

    def __init__(self) -> None:
        self.tension, self.sum = self.least, 0.0

    def step(self, error: float) -> float:
        """The tension after a step, for what the force lacks."""
        self.sum += STEP * error
        command = self.proportional * error + self.integral * self.sum
        command = min(max(command, self.least), self.most)
        self.tension += STEP / (STEP + self.lag) * (command - self.tension)
        return self.tension


# %% [markdown]
# ## In Python
#
# Every step is an equilibrium of finger and hood under the tension of that time.

# %%
controller, force = Controller(), 0.0
by_python = []
for wanted in asked:
    tension = controller.step(wanted - force)
    solved = cosim.couple(case, case, {"EDC": tension}, resting=0.05)
    force = solved.tip_force["dorsal"]
    by_python.append((tension, force))
assert solved.audit.passed
assert abs(force - asked[-1]) < 0.02 * asked[-1]

# %% [markdown]
# ## As a unit
#
# The coupled finger as a unit of FMI 3 takes the tensions and gives the fingertip's force. FMPy
# steps it; any simulator that reads FMI could.

# %%
path = Path("finger.fmu")
write_fmu(case, "coupled", 3, path)
described = read_model_description(str(path))
place = {variable.name: variable.valueReference for variable in described.modelVariables}
tensions = np.full(8, 0.05)  # EDC first, then the others at rest

folder = extract(str(path))
unit = instantiate_fmu(folder, described, fmi_type="CoSimulation")
unit.enterInitializationMode(startTime=0.0)
unit.setFloat64([place["tension"]], list(tensions))
unit.exitInitializationMode()

controller, force = Controller(), 0.0
by_unit = []
for k, wanted in enumerate(asked):
    tensions[0] = controller.step(wanted - force)
    unit.setFloat64([place["tension"]], list(tensions))
    unit.doStep(k * STEP, STEP)
    force = unit.getFloat64([place["tip_force"]], nValues=3)[2]  # distal, radial, dorsal
    by_unit.append((tensions[0], force))
unit.terminate()
unit.freeInstance()
shutil.rmtree(folder)

# %% [markdown]
# Both loops are the same loop: the unit solves what `couple` solves.

# %%
assert np.allclose(by_unit, by_python, rtol=1e-4)
time = STEP * (1 + np.arange(STEPS))
figure, (of_force, of_tension) = plt.subplots(2, 1, sharex=True, layout="constrained")
of_force.step(time, asked, where="pre", color="0.6", label="asked")
for axes, column in ((of_force, 1), (of_tension, 0)):
    axes.plot(time, np.array(by_python)[:, column], color="#0072b2", label="couple")
    axes.plot(time, np.array(by_unit)[:, column], "--", color="#d55e00", label="unit")
    axes.grid(alpha=0.3)
    axes.legend()
of_force.set_ylabel("dorsal force, N")
of_tension.set_ylabel("tension of EDC, N")
of_tension.set_xlabel("time, s")
plt.show()
