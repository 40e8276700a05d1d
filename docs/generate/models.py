"""Tables of settings from pydantic models: key, type, unit, default and meaning."""

import re
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from generate.tables import code, table

_SUFFIXES = {
    "_m2": "m²", "_m3": "m³", "_m_s2": "m/s²", "_m_s": "m/s", "_rad_s": "rad/s", "_deg_s": "deg/s",
    "_deg_sqrt_m": "deg/√m", "_per_ha": "1/ha", "_per_m": "1/m", "_m": "m", "_s": "s", "_deg": "deg", "_hz": "Hz",
    "_kg": "kg", "_w": "W", "_j": "J", "_n": "N", "_px": "pixels", "_mm": "mm", "_share": "share", "_rad": "rad", "_pa": "Pa", "_hpa": "hPa", "_c": "°C", "_k": "K", "_m_we": "m w.e.", "_kg_m3": "kg/m³",
}  # fmt: skip
_UNIT = re.compile(r"\s*\[([^\]]+)\]")


def sections(
    model: type[BaseModel], key: str = "", header: str = ""
) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield every section below a model with its TOML header, the model itself first; alternatives share a header."""
    yield header, model
    for name, field in model.model_fields.items():
        inner_key = f"{key}.{name}" if key else name
        is_list = get_origin(field.annotation) is tuple
        for inner in models_in(field.annotation):
            yield from sections(inner, inner_key, f"[[{inner_key}]]" if is_list else f"[{inner_key}]")


def sections_text(model: type[BaseModel]) -> str:
    """Return a heading, a summary and a table for each section of a file."""
    parts = []
    for header, section in sections(model):
        body = settings_table(section)
        if body:
            parts.append(f"## {heading(header, section)}\n\n{summary(section)}\n\n{body}")
    return "\n".join(parts)


def heading(header: str, section: type[BaseModel]) -> str:
    """Return the heading of a section: its TOML header, and its kind where there are several."""
    if not header:
        return "Top level"
    for name, field in section.model_fields.items():
        kinds = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
        if len(kinds) == 1:
            return f'`{header}` with `{name} = "{kinds[0]}"`'
    return f"`{header}`"


def summary(section: type[BaseModel]) -> str:
    """Return the first paragraph of a section's docstring."""
    return " ".join((section.__doc__ or "").strip().split("\n\n")[0].split()).replace("``", "`")


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a type names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        return
    for part in get_args(annotation):
        yield from models_in(part)


def settings_table(model: type[BaseModel]) -> str:
    """Return the table of a model's own settings, or nothing where all are sections."""
    rows = [
        row(name, field) for name, field in model.model_fields.items() if not any(models_in(field.annotation))
    ]
    return table(("key", "value", "unit", "default", "meaning"), rows) if rows else ""


def row(name: str, field: FieldInfo) -> tuple[str, str, str, str, str]:
    """Return key, type, unit, default and meaning of a setting."""
    meaning = " ".join((field.description or "").split())
    return code(name), values_of(field), unit_of(name, meaning), default_of(field), _UNIT.sub("", meaning)


def unit_of(name: str, meaning: str) -> str:
    """Return the unit of a setting: the one that its meaning states, else that of its name."""
    stated = _UNIT.search(meaning)
    return stated[1] if stated else unit_by_name(name)


def unit_by_name(name: str) -> str:
    """Return the unit with which a name ends, or nothing."""
    fitting = [end for end in _SUFFIXES if name.endswith(end)]
    return _SUFFIXES[max(fitting, key=len)] if fitting else ""


def default_of(field: FieldInfo) -> str:
    """Return the default of a setting as TOML would have it."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "none"
    if isinstance(value, bool):
        return code(str(value).lower())
    if isinstance(value, tuple):
        return code(str(list(value)).replace("'", '"'))
    return code(f'"{value}"' if isinstance(value, str) else str(value))


def values_of(field: FieldInfo) -> str:
    """Return the type of a setting and its bounds."""
    bounds = [bound for item in field.metadata for bound in bounds_of(item)]
    return " ".join([type_text(field.annotation), *sorted(bounds)]).strip()


def bounds_of(item: Any) -> list[str]:
    """Return the bounds that an annotation states."""
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = [
        f"{sign} {getattr(item, name):g}"
        for name, sign in signs.items()
        if getattr(item, name, None) is not None
    ]
    return found + [bound for inner in getattr(item, "metadata", ()) for bound in bounds_of(inner)]


def type_text(annotation: Any) -> str:
    """Return a type in words."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        bounds = [bound for item in arguments[1:] for bound in bounds_of(item)]
        return " ".join([type_text(arguments[0]), *bounds])
    if origin is Literal:
        return ", ".join(code(f'"{value}"' if isinstance(value, str) else str(value)) for value in arguments)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(type_text(part) for part in arguments if part is not NoneType))
    if origin is tuple and arguments:
        inner = dict.fromkeys(type_text(part) for part in arguments if part is not Ellipsis)
        return (
            f"list of {' and '.join(inner)}"
            if Ellipsis in arguments
            else f"list of {len(arguments)}: {' and '.join(inner)}"
        )
    names = {float: "number", int: "integer", str: "text", bool: "true or false"}
    return names.get(annotation, getattr(annotation, "__name__", str(annotation)))
