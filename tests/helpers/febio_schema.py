"""What FEBio's documentation allows in a file, written from it and not from our reader or writer.

The user manual, chapter 3, and the feature manual's pages of the named types
(github.com/febiosoftware/febio-docs, commits 3642826 and a01e45f), as a RELAX NG schema for the
sections that our writer writes; then the names and numbers that refer to each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from xml.sax.saxutils import escape

from lxml import etree

NUMBER = r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"
ID = "[1-9][0-9]*"
FACES = {"tri3": 3, "quad4": 4, "tri6": 6, "quad8": 8, "quad9": 9}
SHELLS = {**FACES, "q4ans": 4, "q4eas": 4}


def text(pattern: str) -> str:
    pattern = escape(rf"\s*{pattern}\s*")
    return f'<data type="string"><param name="pattern">{pattern}</param></data>'


def numbers(count: int, of: str = NUMBER) -> str:
    return text(r"\s*,\s*".join([of] * count))


NAME, NUM, FLAG, IDENT = text(".+"), text(NUMBER), text("[01]"), text(ID)


def el(name: str, *inner: str) -> str:
    return f'<element name="{name}">{"".join(inner) or "<empty/>"}</element>'


def at(name: str, inner: str) -> str:
    return f'<attribute name="{name}">{inner}</attribute>'


def choice(*options: str) -> str:
    return f"<choice>{''.join(options)}</choice>"


def word(*words: str) -> str:
    return choice(*(f"<value>{w}</value>" for w in words))


def opt(*inner: str) -> str:
    return f"<optional>{''.join(inner)}</optional>"


def many(*inner: str) -> str:
    return f"<zeroOrMore>{''.join(inner)}</zeroOrMore>"


def some(*inner: str) -> str:
    return f"<oneOrMore>{''.join(inner)}</oneOrMore>"


def mix(*inner: str) -> str:
    """In any order."""
    return f"<interleave>{''.join(inner)}</interleave>" if len(inner) > 1 else "".join(inner)


def nums(names: str) -> list[str]:
    return [el(name, NUM) for name in names.split()]


def opts(names: str, value: str = NUM) -> list[str]:
    return [opt(el(name, value)) for name in names.split()]


def scaled(name: str, value: str = NUM) -> str:
    return el(name, opt(at("lc", IDENT)), value)


def typed(tag: str, kind: str, *inner: str, **attributes: str) -> str:
    own = [at(name, value) for name, value in attributes.items()]
    return el(tag, at("type", word(kind)), *own, *([mix(*inner)] if inner else []))


FIBRE = opt(el("fiber", at("type", word("vector")), el("vector", numbers(3))))
TISO = [*nums("c1 c2 c3 c4 c5 lam_max"), FIBRE]


def materials() -> str:
    def one(kind: str, *inner: str) -> str:
        return typed("material", kind, *opts("density"), *inner, id=IDENT, name=NAME)

    fibres = typed("solid", "uncoupled fiber-exp-linear", *nums("c3 c4 c5 lambda"), FIBRE)
    tiso = typed("solid", "trans iso Mooney-Rivlin", *TISO)
    stretch = (*nums("stretch"), el("isochoric", FLAG))
    return choice(
        one("isotropic elastic", *nums("E v")),
        one("neo-Hookean", *nums("E v")),
        one("trans iso Mooney-Rivlin", *nums("k"), *TISO),
        one("Mooney-Rivlin", *nums("c1 c2 k")),
        one("Holzapfel-Gasser-Ogden", *nums("c k1 k2 kappa gamma k")),
        one("orthotropic elastic", *nums("E1 E2 E3 G12 G23 G31 v12 v23 v31")),
        one("uncoupled solid mixture", *nums("k"), some(choice(tiso, fibres))),
        one(
            "uncoupled prestrain elastic",
            *nums("k"),
            typed("elastic", "trans iso Mooney-Rivlin", *TISO),
            typed("prestrain", "in-situ stretch", *stretch),
        ),
        one("rigid body", *opts("E v"), *opts("center_of_mass", numbers(3))),
    )


def mesh() -> str:
    def row(tag: str, inner: str) -> str:
        return el(tag, at("id", IDENT), inner)

    elements = [
        el("Elements", at("type", word(k)), at("name", NAME), some(row("elem", numbers(n, ID))))
        for k, n in SHELLS.items()
    ]
    facets = choice(*(row(k, numbers(n, ID)) for k, n in FACES.items()))
    ids = text(rf"({ID}(\s*,\s*{ID})*)?")
    sides = mix(el("primary", NAME), el("secondary", NAME))
    return el(
        "Mesh",
        mix(
            some(el("Nodes", opt(at("name", NAME)), some(row("node", numbers(3))))),
            some(choice(*elements)),
            many(el("NodeSet", at("name", NAME), ids)),
            many(el("Surface", at("name", NAME), some(facets))),
            many(el("DiscreteSet", at("name", NAME), some(el("delem", numbers(2, ID))))),
            many(el("SurfacePair", at("name", NAME), sides)),
        ),
    )


def mesh_data() -> str:
    thickness = choice(*(numbers(n) for n in sorted({*SHELLS.values()})))
    axes = mix(el("a", numbers(3)), el("d", numbers(3)))
    return many(
        choice(
            typed(
                "ElementData",
                "shell thickness",
                some(el("e", at("lid", IDENT), thickness)),
                elem_set=NAME,
            ),
            typed(
                "ElementData", "mat_axis", some(el("elem", at("lid", IDENT), axes)), elem_set=NAME
            ),
        )
    )


def conditions() -> list[str]:
    def bc(kind: str, *inner: str) -> str:
        return typed("bc", kind, *inner, name=NAME, node_set=NAME)

    def rigid(kind: str, *inner: str) -> str:
        return typed("rigid_bc", kind, el("rb", NAME), *inner)

    parent = (el("node", IDENT), el("dof", word("x", "y", "z")))
    dof = el("dof", word("x", "y", "z", "sx", "sy", "sz"))
    child = el("child_dof", el("node", IDENT), dof, el("value", NUM))
    moved = (scaled("value"), *opts("relative", FLAG))
    fixed = opts("Rx_dof Ry_dof Rz_dof Ru_dof Rv_dof Rw_dof", FLAG)
    on_nodes = (scaled("value", numbers(3)), *opts("relative shell_bottom", FLAG))
    on_faces = (scaled("pressure"), *opts("linear symmetric_stiffness shell_bottom", FLAG))
    slides = opts("laugon auto_penalty two_pass shell_bottom_primary shell_bottom_secondary", FLAG)
    return [
        el(
            "Boundary",
            many(
                choice(
                    bc("rigid", el("rb", NAME), *opts("clamp_shells", FLAG)),
                    bc("zero displacement", *opts("x_dof y_dof z_dof", FLAG)),
                    bc("zero shell displacement", *opts("sx_dof sy_dof sz_dof", FLAG)),
                    bc("prescribed displacement", el("dof", word("x", "y", "z")), *moved),
                    typed("bc", "linear constraint", *parent, some(child)),
                )
            ),
        ),
        el(
            "Rigid",
            many(
                choice(
                    rigid("rigid_fixed", *fixed),
                    rigid("rigid_displacement", el("dof", word("x", "y", "z")), *moved),
                    rigid("rigid_rotation", el("dof", word("Ru", "Rv", "Rw")), *moved),
                )
            ),
        ),
        el(
            "Loads",
            many(
                choice(
                    typed("nodal_load", "nodal_force", *on_nodes, name=NAME, node_set=NAME),
                    typed("surface_load", "pressure", *on_faces, name=NAME, surface=NAME),
                )
            ),
        ),
        el(
            "Contact",
            many(
                typed(
                    "contact",
                    "sliding-elastic",
                    *opts("penalty fric_coeff offset search_tol search_radius"),
                    *slides,
                    name=NAME,
                    surface_pair=NAME,
                )
            ),
        ),
    ]


def curves() -> tuple[str, str]:
    """The sections Discrete and LoadData."""
    points = (
        opt(el("interpolate", word("LINEAR", "STEP", "SMOOTH", "SMOOTH STEP"))),
        opt(el("extend", word("CONSTANT", "EXTRAPOLATE", "REPEAT", "REPEAT OFFSET"))),
        el("points", some(el("pt", numbers(2)))),
    )

    def spring(kind: str, *inner: str) -> str:
        return typed("discrete_material", kind, *inner, id=IDENT, name=NAME)

    ends = opts("left_extend right_extend", word("zero", "constant", "repeat"))
    formula = el("math", NAME)
    return (
        el(
            "Discrete",
            many(
                choice(
                    spring("linear spring", *nums("E")),
                    spring("tension-only linear spring", *nums("E")),
                    spring(
                        "nonlinear spring", el("force", at("type", word("point")), mix(*points))
                    ),
                )
            ),
            many(el("discrete", at("dmat", IDENT), at("discrete_set", NAME))),
        ),
        el(
            "LoadData",
            many(
                choice(
                    typed("load_controller", "loadcurve", *points, id=IDENT),
                    typed("load_controller", "math", formula, id=IDENT),
                    typed(
                        "load_controller",
                        "math-interval",
                        formula,
                        el("interval", numbers(2)),
                        *ends,
                        id=IDENT,
                    ),
                )
            ),
        ),
    )


@cache
def schema() -> etree.RelaxNG:
    stiffness = el("symmetric_stiffness", word("symmetric", "non-symmetric", "preferred"))
    longest = el("dtmax", opt(at("lc", IDENT)), NUM)
    control = el(
        "Control",
        mix(
            *opts("analysis", word("STATIC")),
            el("time_steps", IDENT),
            *nums("step_size"),
            opt(el("solver", at("type", word("solid")), stiffness)),
            opt(el("time_stepper", at("type", word("default")), longest)),
        ),
    )
    domain = el("ShellDomain", at("name", NAME), at("mat", NAME), *nums("shell_thickness"))
    variables = many(el("var", at("type", NAME)))
    discrete, load_data = curves()
    root = el(
        "febio_spec",
        at("version", word("4.0")),
        el("Module", at("type", word("solid"))),
        opt(el("Globals", el("Constants", mix(*nums("T R Fc"))))),
        opt(control),
        el("Material", some(materials())),
        mesh(),
        el("MeshDomains", some(domain)),
        el("MeshData", mesh_data()),
        *conditions(),
        discrete,
        opt(el("Step", some(el("step", at("id", IDENT), opt(at("name", NAME)), control)))),
        load_data,
        opt(el("Output", el("plotfile", at("type", word("febio")), variables))),
    )
    library = "http://www.w3.org/2001/XMLSchema-datatypes"
    head = f'xmlns="http://relaxng.org/ns/structure/1.0" datatypeLibrary="{library}"'
    whole = f"<grammar {head}><start>{root}</start></grammar>"
    return etree.RelaxNG(etree.fromstring(whole.encode()))


def faults(path: Path) -> list[str]:
    """What in a file FEBio's documentation does not allow; none where all is."""
    tree = etree.parse(str(path))
    rules = schema()
    rules.validate(tree)
    return [f"line {e.line}: {e.message}" for e in rules.error_log] + [*unknown_names(tree)]


def unknown_names(tree: etree._ElementTree) -> Iterator[str]:
    """What a file refers to and does not have, and what it numbers or names twice."""
    root = tree.getroot()

    def said(path: str) -> list[str]:
        return [str(v).strip() for v in root.xpath(path)]

    parts, bodies = said("//Elements/@name"), said("//material[@type='rigid body']/@name")
    pairs = [
        ("//@lc", "//load_controller/@id"),
        ("//@node_set", "//NodeSet/@name"),
        ("//@surface", "//Surface/@name"),
        ("//SurfacePair/*/text()", "//Surface/@name"),
        ("//@surface_pair", "//SurfacePair/@name"),
        ("//@discrete_set", "//DiscreteSet/@name"),
        ("//@dmat", "//discrete_material/@id"),
        ("//ShellDomain/@mat", "//material/@name"),
        ("//ShellDomain/@name | //@elem_set", "//Elements/@name"),
        ("//rb/text()", "//material[@type='rigid body']/@name"),
    ]
    for refer, own in pairs:
        missing = {*said(refer)} - {*said(own)}
        if missing:
            yield f"{refer}: there is no {sorted(missing)}"
        if len({*said(own)}) != len(said(own)):
            yield f"{own}: twice"
    nodes = {*said("//node/@id")}
    used = "//Elements/elem/text() | //NodeSet/text() | //Surface/*/text() | //delem/text()"
    for value in said(used):
        if lost := {v.strip() for v in value.split(",")} - nodes:
            yield f"there is no node {sorted(lost)}"
    for twice in (said("//node/@id"), said("//Elements/elem/@id"), parts, bodies):
        if len({*twice}) != len(twice):
            yield "an id or a name comes twice"
    if {*said("//ShellDomain/@name")} != {*parts}:
        yield "a part has no domain"
