"""Settings of short motions, a motion that is interrupted, and whether two are the same."""

from __future__ import annotations

from cosim.results.data import Result

PLAIN = "output.picture=false"
FREE = (
    "finger.tip={kind='free'}",
    "finger.limit={half_range='40 deg',stiffness='20 N*m/deg',transition='5 deg',"
    "damping='0.01 N*m*s/deg'}",
    'tendons.EDC.course={kind="points",at=[["0 s",0.02],["0.05 s",1.0]]}',
)
HELD = tuple(
    f'finger.passive.{joint}={{stiffness="0.0391 N*m/rad",rest="posture",'
    'damping="0.001 N*m*s/rad"}'
    for joint in ("MCP", "MCP_abduction", "PIP", "DIP")
)


class Stopper:
    """Progress that interrupts a motion in its n-th word, as Ctrl-C does."""

    def __init__(self, words: int) -> None:
        self.left = words

    def __call__(self, text: str) -> None:
        self.left -= text.startswith("t = ")
        if not self.left:
            raise KeyboardInterrupt


def identical(a: Result, b: Result) -> bool:
    return all(
        a.dataset[name].values.tobytes() == b.dataset[name].values.tobytes()
        for name in (*a.dataset.data_vars, "time")
    )
