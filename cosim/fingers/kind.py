"""What a kind of finger is: its table, and how it is built."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar, get_args

from cosim.fingers.common import Extensor, FingerConfig
from cosim.port import Triangles

if TYPE_CHECKING:
    from meshes.skeleton import Skeleton
    from rigid.chain.statics import ChainFinger
    from rigid.model import FingerModel

T = TypeVar("T", bound=FingerConfig)
Eyelets = Mapping[str, tuple[float, float, float]]
"""By tendon, the point beside the metacarpal (m distal of the MCP, dorsal, radial) that it glides
through on its way to a hood."""


@dataclass(frozen=True)
class FingerKind(Generic[T]):
    """A kind of finger.  What it lacks is None: a program of another's has its table alone."""

    table: type[T]
    build: Callable[[T, Extensor], ChainFinger] | None = None
    """The live finger, with those tendons of its own that the hood leaves to it."""
    bones: Callable[[T, Extensor], Mapping[str, Triangles]] | None = None
    """Surfaces in the bodies' frames, m."""
    model: Callable[[T, Extensor], FingerModel] | None = None
    """Bones, joints and tendons of its MuJoCo model."""
    skeleton: Callable[[T], Skeleton] | None = None
    """Joints and lengths that a hood is laid out on."""
    width: Callable[[T], float] = lambda finger: 1.0
    """How much wider it is than our index finger."""
    eyelets: Callable[[T], Eyelets] = lambda finger: {}
    """Where the intrinsic tendons run to a sheet from."""
    tendons: Callable[[T], tuple[str, ...]] = lambda finger: ()
    """Names of its own tendons, where there is no model that has them."""

    @property
    def name(self) -> str:
        """The word in `finger.kind`."""
        word: str = get_args(self.table.model_fields["kind"].annotation)[0]
        return word


@dataclass(frozen=True)
class Anatomy:
    """What a hood is laid out on, and pictures show."""

    finger: str
    """The kind."""
    key: str
    """A text that two fingers share only where bones and joints are alike."""
    skeleton: Skeleton | None
    bones: Mapping[str, Triangles]
    """m, in the bodies' frames."""
    width: float
    eyelets: Eyelets
    model: FingerModel | None
    """None of hinges in one plane, which are joined in a row."""
    hooded: tuple[str, ...] = ()
    """The model's tendons that part by fixed shares, or that another hood would take over."""
