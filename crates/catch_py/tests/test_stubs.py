"""The stubs say what the module has: names and signatures."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import catchingbot
from catchingbot import _catchingbot

STUBS = ast.parse((Path(catchingbot.__file__).parent / "_catchingbot.pyi").read_text())


def stated(function: ast.FunctionDef) -> list[tuple[str, str, object]]:
    """Names, kinds and defaults of the parameters, `self` and `cls` aside."""
    arguments = function.args
    defaults = [None] * (len(arguments.posonlyargs + arguments.args) - len(arguments.defaults)) + arguments.defaults
    kinds = ["positional"] * len(arguments.posonlyargs) + ["either"] * len(arguments.args)
    found = list(zip(arguments.posonlyargs + arguments.args, kinds, defaults, strict=True))
    found += [(it, "keyword", default) for it, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)]
    value = lambda it: inspect.Parameter.empty if it is None else ast.literal_eval(it)
    return [(it.arg, kind, value(default)) for it, kind, default in found if it.arg not in ["self", "cls"]]


def real(function: object) -> list[tuple[str, str, object]]:
    kinds = {"POSITIONAL_ONLY": "positional", "POSITIONAL_OR_KEYWORD": "either", "KEYWORD_ONLY": "keyword"}
    parameters = inspect.signature(function).parameters.values()
    return [(it.name, kinds[it.kind.name], it.default) for it in parameters if it.name != "self"]


def is_public(name: str) -> bool:
    return not name.startswith("_") or name == "__version__"


def test_the_module_has_what_its_stubs_say():
    classes = {it.name: it for it in STUBS.body if isinstance(it, ast.ClassDef) and is_public(it.name)}
    functions = {it.name: it for it in STUBS.body if isinstance(it, ast.FunctionDef)}
    names = {*classes, *functions, *(it.target.id for it in STUBS.body if isinstance(it, ast.AnnAssign) and is_public(it.target.id))}
    assert names == {name for name in dir(_catchingbot) if is_public(name)}
    assert names - {"columns", "parquet", "viewed"} | {"Table"} == set(catchingbot.__all__)
    for name, function in functions.items():
        assert stated(function) == real(getattr(_catchingbot, name)), name
    for name, stub in classes.items():
        native = getattr(_catchingbot, name)
        if issubclass(native, Exception):
            continue
        assert native.__module__ == "catchingbot" and native.__doc__, name
        members = {it.name: it for it in stub.body if isinstance(it, ast.FunctionDef)}
        own = {it for it in vars(native) if is_public(it) or it in ["_repr_html_", "__reduce__", "__getnewargs__"]}
        assert own == members.keys() - {"__new__"}, name
        for member, function in members.items():
            is_property = any(isinstance(it, ast.Name) and it.id == "property" for it in function.decorator_list)
            value = vars(native).get(member)
            if member == "__new__":
                assert stated(function) == real(native), name
            elif is_property:
                assert inspect.isgetsetdescriptor(value) and value.__doc__, f"{name}.{member}"
            else:
                assert stated(function) == real(value), f"{name}.{member}"
