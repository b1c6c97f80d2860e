"""What a kind of hood is: its table, and how it is built on a finger."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, get_args

from cosim.errors import InputError
from cosim.fingers.common import Extensor
from cosim.fingers.kind import Anatomy
from cosim.hoods.lesion import InjurableParts, LesionConfig
from cosim.hoods.variation import Settings, Variation, no_variation
from cosim.hoods.view import NO_POINTS, Colour, HoodView, TrackedPoints
from cosim.port import Array, Hood, Motion, State
from cosim.schema.types import Table

if TYPE_CHECKING:
    from meshes.hood_mesh import HoodMesh
    from meshes.skeleton import Skeleton
    from rigid.mjcf.hood import HoodParts

FINGERS = ("index", "middle", "ring", "little")
"""The kinds of finger with the joints of a human one."""
Slips = Mapping[str, float]
"""N, in the central and the terminal slip."""


class HoodConfig(Table):
    """What the table of any hood says without a solver."""

    title: ClassVar[str]
    """The kind in words, for reports."""
    fits: ClassVar[tuple[str, ...]]
    """The kinds of finger that it goes on."""
    lies_on_bones: ClassVar[bool] = False
    """A sheet or net of finite elements: laid out on bones, and without hold where all is slack."""
    is_coupled: ClassVar[bool] = True
    """False where the finger's own tendons stand for it."""
    needs_no_tension: ClassVar[bool] = True
    """Its tendons may go slack."""
    can_be_injured: ClassVar[bool] = False
    rungs: ClassVar[Mapping[str, str]] = {}
    """Rungs of the ladder of hoods, with the packaged case that states each."""
    example: ClassVar[tuple[str, ...]] = ()
    """A packaged case, and settings, with such a hood: small, for tests.  None of a hood that a
    program of the user's is."""

    @property
    def left_to_finger(self) -> Extensor:
        """The part of the extensor mechanism that the finger makes."""
        return Extensor(lies_on_bones=self.lies_on_bones)

    @property
    def shares_fixed(self) -> bool:
        """Whether joint torques are linear in the tensions."""
        return False

    @property
    def generated_quads(self) -> int | None:
        """About how many quads (`hood.mesh.quads`) its mesh has; None where none is generated."""
        return None

    @property
    def mesh_fineness(self) -> int | None:
        """The whole number by which its mesh is finer than the coarsest of one family; None where
        it has no such meshes."""
        return None

    def mesh_values(self, fineness: int) -> dict[str, Any]:
        """The values by dotted key that lay it on the mesh of its family that is so fine."""
        return {}

    @property
    def has_smooth_tangent(self) -> bool:
        """Whether it is a sheet that answers small changes by its tangent."""
        return False

    @property
    def has_friction(self) -> bool:
        """Whether it rubs on the bones, so that its load depends on its path and arms by force and
        by excursion differ."""
        return False

    def tendon_names(self, finger: str) -> tuple[str, ...] | None:
        """The tendons that pull on it, on a finger of that kind; None where only building tells."""
        return None

    def source_names(self) -> tuple[str, ...]:
        """The sources of its load that its table names."""
        return ()

    def parts(self) -> InjurableParts | None:
        """What a lesion can do to it."""
        return None

    def cannot_be_injured(self, lesion: LesionConfig) -> str:
        """Why it cannot have a lesion that names none but its parts; empty where it can."""
        return ""

    def files(self) -> tuple[Path, ...]:
        """The files that the hood is built from."""
        return ()

    def check_files(self) -> None:
        """Check that its files can be read.  Raises InputError."""

    def mesh_key(self) -> str:
        """A text that two hoods share only where they are laid out alike on the same bones."""
        return ""

    def laws(self, kind: str) -> Mapping[str, Any]:
        """The regions whose material is of that kind."""
        return {}

    def followers(self) -> Mapping[str, str]:
        """By the key of a value that parts share, which of them follow it in this case, as a clause
        without its subject."""
        return {}

    def rung(self) -> str:
        """The rung of the ladder on which it stands."""
        return kind_of(type(self))

    def on_finger(self, finger: str, laid: Any) -> HoodConfig:
        """The hood for a finger of that kind; `laid`: one laid out on such a finger, if any."""
        return self

    def lines(self, motion: Motion) -> Mapping[str, Array]:
        """What pictures draw of it as lines at these poses, (k, 3) m each."""
        return {}


H = TypeVar("H", bound=HoodConfig)


@dataclass(frozen=True)
class Site:
    """What a hood is built on: of the finger and the case, and nothing more."""

    anatomy: Anatomy
    rest: Motion
    """The poses from which the excursions of a hood that is not laid out count."""
    lesion: LesionConfig | None
    tolerance: float
    """The tolerance of the hood's own equilibrium, relative."""

    @property
    def skeleton(self) -> Skeleton:
        """The finger's skeleton.  Raises InputError for a finger that no hood is laid out on."""
        return skeleton_of(self.anatomy)


def skeleton_of(anatomy: Anatomy) -> Skeleton:
    """The finger's skeleton.  Raises InputError for a finger that no hood is laid out on."""
    if anatomy.skeleton is None:
        raise InputError(f'finger.kind = "{anatomy.finger}" has no skeleton; take another kind')
    return anatomy.skeleton


@dataclass(frozen=True)
class BuiltHood:
    """A hood behind the port, and what else there is to know of its states."""

    hood: Hood
    view: Callable[[State], HoodView] | None = None
    """What a state looks like; None for a hood without a shape."""
    slips: Callable[[State], Slips] | None = None
    """N in the slips at a state; None for a hood without."""
    own_slips: Callable[[Mapping[str, float]], Slips] | None = None
    """N in the slips from the tensions (N) of the finger's own tendons, where these make them."""
    linear: Callable[[State], tuple[float, float]] | None = None
    """Seconds of one assembly and of one factorisation of its tangent at a state."""
    points: TrackedPoints = NO_POINTS
    """The points of the user's on it."""
    energy: Callable[[State], float] | None = None
    """J stored at a state in sheet or cables, springs and contact; None of a hood in closed form.
    At its equilibrium this less the tendons' work, tension times excursion, is stationary."""
    nearby: Callable[[State, Motion], State] | None = None
    """A solved state at poses nearby under the same tensions, to first order; None as before."""
    around: Callable[[Any], BuiltHood] | None = None
    """What there is to know of a hood of the same mesh with other springs or ties; None of a hood
    without."""
    others: Callable[[], Mapping[str, Callable[[Any, State], float]]] = dict
    """Parts without springs that can give way: N that each bears in a state of a hood of the same
    mesh."""
    without: Callable[[Sequence[str]], Hood] | None = None
    """The hood without some of them; None of one that has none."""

    def view_of(self, state: State) -> HoodView | None:
        """What a state looks like; None for a hood without a shape."""
        return None if self.view is None else self.view(state)

    def slip_forces(self, state: State, tendons: Sequence[str], tension: Array) -> Slips:
        """N in the slips at a state, or of the finger's own tendons under `tension` (nt,) N,
        whichever make them; none of a hood without."""
        if self.slips is not None:
            return self.slips(state)
        if self.own_slips is not None:
            return self.own_slips(dict(zip(tendons, map(float, tension), strict=True)))
        return {}


def no_variations(hood: HoodConfig) -> Iterator[Variation]:
    """The variations of a hood that has nothing to vary: none, each with its reason."""
    for name in ("modulus", "thickness", "mesh"):
        yield no_variation(name, f"a hood of kind {kind_of(type(hood))!r} has none")


@dataclass(frozen=True)
class MujocoHood:
    """A hood that acts by joint torques, as plain MuJoCo can have it."""

    word: str
    """What `cosim export --hood` calls it."""
    joints: tuple[str, ...]
    """The joints on which it acts."""
    box: tuple[Mapping[str, tuple[float, float]], Mapping[str, float]] | None
    """The angles (rad) by joint and greatest tensions (N) in which it is known; None: in all."""
    parts: Callable[[Array, Array, Array], HoodParts]
    """Its parts, fitted where they are not its own to angles (s, n) rad, tensions (s, m) N and the
    maps (s, 3, n) from torques to the fingertip's force."""
    slips: Callable[[Mapping[str, float], Array, Array], Slips]
    """N in the slips, of the tensions (N) of its parts' bands, angles (n,) rad and torques (n,)."""
    held: tuple[str, ...] = ()
    """Joints of the box whose angle was one and the same where the hood was measured."""


@dataclass(frozen=True)
class HoodBuilder(Generic[H]):
    """How a kind of hood is built: what knows its solver."""

    build: Callable[[H, Site], BuiltHood]
    """Raises InputError for what only building finds out."""
    mesh: Callable[[H, Anatomy], HoodMesh] | None = None
    """The sheet as laid out or read, before any lesion."""
    in_mujoco: Callable[[H, LesionConfig | None], MujocoHood] | None = None
    """As plain MuJoCo can have it; None of a hood that it cannot.  Raises InputError."""
    mesh_warnings: Callable[[H, Anatomy], Sequence[str]] = lambda hood, anatomy: ()
    """What to know of its mesh.  Raises InputError."""
    mesh_advice: Callable[[H, Anatomy], str] = lambda hood, anatomy: ""
    """What to do about its mesh where a solve fails.  Raises InputError."""


@dataclass(frozen=True)
class HoodKind(Generic[H]):
    """A kind of hood: what can be said of it without its solver."""

    table: type[H]
    builder_name: str
    """`module:name` of its HoodBuilder."""
    colours: tuple[Colour, ...] = ()
    """What reports colour it by."""
    variations: Callable[[H], Iterable[Variation]] = no_variations
    """What a sensitivity study varies of it."""
    scaled_moduli: Callable[[H, float], Settings] = lambda hood, factor: ()
    """What multiplies all its moduli by a factor; nothing of a hood that is no sheet."""

    @property
    def name(self) -> str:
        """The word in `hood.kind`."""
        return kind_of(self.table)

    @property
    def builder(self) -> HoodBuilder[H]:
        """How it is built; loads its solver."""
        builder: HoodBuilder[H] = resolve_name(self.builder_name)
        return builder


def kind_of(table: type[Table]) -> str:
    """The word in the `kind` of a table."""
    word: str = get_args(table.model_fields["kind"].annotation)[0]
    return word
