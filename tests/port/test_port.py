"""The port's own mathematics: rotations, twists, and the balance of a load."""

from __future__ import annotations

import importlib
import pickle
import pkgutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cosim
import fe_solver
import meshes
import rigid
from cosim.errors import CosimError, InputError
from cosim.port import Load, Motion, rotation_matrix, rotation_vector, skew

BODIES = ("a", "b", "c")
vectors = st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3).map(np.array)
tiny = st.floats(1e-9, 1e-3)


def motion(seed: int = 0) -> Motion:
    rng = np.random.default_rng(seed)
    return Motion(BODIES, rng.normal(size=(3, 3)), rotation_matrix(rng.normal(size=(3, 3))))


@given(vectors, tiny)
def test_rotation_is_orthonormal_and_keeps_its_axis(vector: np.ndarray, small: float) -> None:
    for v in (vector, small * vector):
        R = rotation_matrix(v)
        assert pytest.approx(np.eye(3), abs=1e-14) == R @ R.T
        assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-14)
        assert R @ v == pytest.approx(v, abs=1e-14)


def test_rotation_turns_right_handed() -> None:
    quarter = rotation_matrix(np.array([0.0, np.pi / 2, 0.0]))
    assert quarter @ [1, 0, 0] == pytest.approx([0, 0, -1])  # flexion about +y: distal to palmar


@given(vectors, vectors)
def test_skew_is_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    assert skew(a) @ b == pytest.approx(np.cross(a, b), abs=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-6, 1.0, 1.6, 3.1, np.pi - 1e-7])
def test_a_rotation_vector_is_found_again_from_its_matrix(size: float) -> None:
    vectors = size * np.array([[0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])
    found = rotation_vector(rotation_matrix(vectors))
    assert found == pytest.approx(vectors, rel=1e-9, abs=1e-15)


@settings(max_examples=30)
@given(st.lists(vectors, min_size=6, max_size=6))
def test_twist_to_undoes_displaced(parts: list[np.ndarray]) -> None:
    twist = np.array(parts).reshape(3, 6)
    assert motion().twist_to(motion().displace(twist)) == pytest.approx(twist, abs=1e-9)


def test_moved_is_a_rigid_motion() -> None:
    m, R, shift = motion(), rotation_matrix(np.array([0.3, -2.0, 0.9])), np.array([1.0, 2.0, 3.0])
    moved = m.transform(R, shift)
    origin, rotation = moved.of("b")
    assert origin == pytest.approx(R @ m.position[1] + shift)
    assert rotation == pytest.approx(R @ m.rotation[1])
    back = moved.transform(R.T, -R.T @ shift)
    assert back.position == pytest.approx(m.position)


def test_motion_refuses_wrong_shapes_and_values() -> None:
    with pytest.raises(InputError, match=r"expected position \(3, 3\)"):
        Motion(BODIES, np.zeros((2, 3)), np.tile(np.eye(3), (3, 1, 1)))
    with pytest.raises(InputError, match="not finite"):
        Motion(BODIES, np.full((3, 3), np.nan), np.tile(np.eye(3), (3, 1, 1)))
    with pytest.raises(InputError, match="expected wrench"):
        Load(BODIES, ("s",), np.zeros((3, 6)), np.zeros((0, 6)))


def balanced_load(m: Motion) -> Load:
    """One tendon through the world's origin, carried by body b."""
    force = np.array([3.0, -4.0, 12.0])
    wrench = np.zeros((3, 1, 6))
    wrench[1, 0] = np.concatenate([force, np.cross(-m.position[1], force)])
    return Load(BODIES, ("s",), wrench, np.concatenate([force, np.zeros(3)])[None])


def test_imbalance_is_relative_to_the_largest_force_and_distance() -> None:
    m = motion()
    load = balanced_load(m)
    assert max(load.imbalance(m)) < 1e-15
    load.wrench[0, 0, 0] += 0.13  # N, at body a
    force, moment = load.imbalance(m)
    assert force == pytest.approx(0.01)  # of 13 N
    arm = np.linalg.norm(m.position[0, 1:])  # of a force along x
    span = np.ptp(m.position, axis=0).max()
    assert moment == pytest.approx(0.13 * arm / (13.0 * span))


def kinds(of: type[CosimError] = CosimError) -> list[type[CosimError]]:
    return [of, *(deeper for kind in of.__subclasses__() for deeper in kinds(kind))]


def test_every_error_can_be_named_and_comes_back_from_a_process() -> None:
    for room in (cosim, fe_solver, meshes, rigid):
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            importlib.import_module(module.name)
    found = kinds()
    assert len(found) > 4
    for kind in found:
        again = kind(f"a case: {kind('words')}")
        assert str(again) == "a case: words"
        assert str(pickle.loads(pickle.dumps(again))) == "a case: words"
