"""One command for several functions: the ending of its file, or an option, says which is meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from cosim.errors import InputError

Way = Callable[..., None]


def door(ways: Mapping[str, Way]) -> Callable[[Way], Way]:
    """A decorator of a function that is no more than the parameters which all ways share and the
    help: the command that calls one of `ways`.  Their keys are an ending of --out (".gif"), the
    option that asks for one ("--resume"), or "" where neither is given.

    The command has the options of every way.  A way gets what was given, by its parameter's name,
    and has its own defaults for the rest; an option that it does not take is an InputError, and so
    is a parameter without a default that was not given."""

    def decorate(head: Way) -> Way:
        shared = dict(signature(head, eval_str=True).parameters)
        every, takers = shared | {}, dict[str, list[str]]()
        for key, way in ways.items():
            for name, parameter in signature(way, eval_str=True).parameters.items():
                both = (every.setdefault(name, parameter), parameter)
                infos = [p.annotation.__metadata__[0] for p in both if _has_info(p)]
                if infos and infos[0].default != infos[-1].default:
                    raise TypeError(f"{head.__name__}: {key} has another option called {name}")
                takers.setdefault(name, []).append(key)

        def command(ctx: typer.Context, **values: Any) -> None:
            labels = {p.name: _label(p) for p in ctx.command.params}
            given = {name: value for name, value in values.items() if _is_given(ctx, name)}
            key = _key(ways, given, labels)
            takes = signature(ways[key]).parameters
            for name in given:
                if name not in takes:
                    raise InputError(_refusal(labels[name], takers.get(name, ()), key))
            for name, parameter in takes.items():
                if parameter.default is Parameter.empty and name not in given:
                    raise InputError(f"{labels[name]} is missing; see {ctx.command_path} -h")
            ways[key](**given)

        own = [_as_option(p, takers[name]) for name, p in every.items() if name not in shared]
        shown = [p.replace(kind=Parameter.KEYWORD_ONLY) for p in (*shared.values(), *own)]
        context = Parameter("ctx", Parameter.KEYWORD_ONLY, annotation=typer.Context)
        command.__signature__ = Signature([context, *shown])  # type: ignore[attr-defined]
        command.__annotations__ = {p.name: p.annotation for p in (context, *shown)}
        command.__doc__, command.__name__ = head.__doc__, head.__name__
        return command

    return decorate


def _has_info(parameter: Parameter) -> bool:
    return hasattr(parameter.annotation, "__metadata__")


def _as_option(parameter: Parameter, takers: Sequence[str]) -> Parameter:
    """A way's parameter as the command has it: it need not be given, and its help says whose it
    is."""
    kind, info = get_args(parameter.annotation)
    if "" not in takers and info.default not in takers:
        info = copy(info)
        info.help = f"{', '.join(takers)}: {info.help}"
    default = None if parameter.default is Parameter.empty else parameter.default
    changed: Any = Annotated[kind, info]
    return parameter.replace(annotation=changed, default=default)


def _is_given(ctx: typer.Context, name: str) -> bool:
    source = ctx.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def _label(parameter: Any) -> str:
    """What a user calls a parameter: `--out`, or the CASE of the line of usage."""
    long = [option for option in parameter.opts if option.startswith("--")]
    return str(long[0] if long else parameter.metavar or parameter.name.upper())


def _key(ways: Mapping[str, Way], given: Mapping[str, Any], labels: Mapping[str, str]) -> str:
    asked = [labels[name] for name in given if labels[name] in ways]
    endings = [key for key in ways if key.startswith(".")]
    out: Path | None = given.get("out")
    if asked or not endings or (out is None and "" in ways):
        return asked[0] if asked else ""
    ending = "" if out is None else out.suffix.lower()
    if ending not in endings:
        place = "--out is missing" if out is None else f"{out}: is of no known kind"
        raise InputError(f"{place}; name a file ending in one of {', '.join(endings)}")
    return ending


def _refusal(label: str, takers: Sequence[str], key: str) -> str:
    here = f"does not go with {key}" if key else "does nothing here"
    there = f", only with {', '.join(filter(None, takers))}" if any(takers) else ""
    return f"{label}: {here}{there}; leave it out"
