"""Bones of the user's: read, scaled, or refused with what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.models.build import build, hood_mesh
from meshes.bones import load_bone

COARSE = "hood.mesh.quads=120"
PULLEY = (
    "hood.kind=pulley",
    'hood.paths.EDC=[{body="metacarpal", point=["-1 cm", "0 mm", "8 mm"]},'
    ' {body="distal", point=["3 mm", "0.1 mm", "2 mm"]}]',
)


def bone_setting(path: Path, unit: str = "m", frame: str = "ours") -> str:
    return f'finger.bones.proximal={{surface="{path.as_posix()}", unit="{unit}", frame="{frame}"}}'


def test_our_own_bone_given_back_as_the_users_makes_the_same_hood(tmp_path: Path):
    load_bone("proximal").write_stl(tmp_path / "proximal.stl")
    given = hood_mesh(load_case("isometric_edc", [COARSE, bone_setting(tmp_path / "proximal.stl")]))
    ours = hood_mesh(load_case("isometric_edc", [COARSE]))
    np.testing.assert_array_equal(given.quads, ours.quads)
    assert np.abs(given.points - ours.points).max() < 1e-6


def test_a_bone_in_millimetres_or_in_the_other_frame_is_the_same_bone(tmp_path: Path):
    from meshes.skeleton import index_finger

    vertices, faces = load_bone("proximal").surface(2e-3)
    rotation, origin = index_finger().source["proximal"]
    write_obj(tmp_path / "mm.obj", 1e3 * vertices, faces)
    write_obj(tmp_path / "myohand.obj", vertices @ rotation.T + origin, faces)
    for name, unit, frame in (("mm", "mm", "ours"), ("myohand", "m", "myohand")):
        setting = bone_setting(tmp_path / f"{name}.obj", unit, frame)
        bones = build(load_case("isometric_edc", [*PULLEY, setting])).bones
        read_back = bones["proximal"][0]
        assert len(read_back) == len(vertices)
        np.testing.assert_allclose(np.sort(read_back, 0), np.sort(vertices, 0), atol=1e-8)


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines))


TRIANGLE = "v 0 0 0\nv 0.01 0 0\nv 0 0.01 0\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.stl", b"hello", "no triangles"),
        ("a.stl", b"", "no triangles"),
        ("a.stl", bytes(range(256)) * 4, "no triangles"),
        ("a.txt", b"hello", "is not one of .stl, .obj, .ply, .off; give a closed surface"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "cannot be read as a triangle surface"),
        ("a.obj", TRIANGLE.encode(), "not watertight"),
        ("a.obj", TRIANGLE.replace("0.01", "10").encode(), "is 1e+04 mm long as m"),
        ("a.obj", TRIANGLE.replace("0.01", "1e-5").encode(), "is 0.01 mm long as m"),
        ("a.obj", TRIANGLE.replace("0.01", "nan").encode(), r"bones.proximal"),
    ],
)
def test_a_bad_bone_is_one_clear_fault(tmp_path: Path, name, content, complaint):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        hood_mesh(load_case("isometric_edc", [COARSE, bone_setting(tmp_path / name)]))
    message = str(caught.value)
    assert complaint in message
    assert message.startswith("finger.bones.proximal.surface: ")
    assert "\n" not in message


def test_a_bone_with_a_hole_is_told(tmp_path: Path):
    vertices, faces = load_bone("proximal").surface(2e-3)
    write_obj(tmp_path / "hole.obj", vertices, faces[5:])
    with pytest.raises(InputError, match=r"finger\.bones\.proximal\.surface: .*not watertight"):
        hood_mesh(load_case("isometric_edc", [COARSE, bone_setting(tmp_path / "hole.obj")]))


def test_a_bone_that_is_not_there_is_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"finger\.bones\.proximal\.surface.*no such file"):
        load_case("isometric_edc", [bone_setting(tmp_path / "none.stl")])
