"""Configuration: strict, frozen pydantic models, TOML files and overrides."""

import difflib
import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from survey.core.errors import ConfigError
from survey.core.files import existing_file

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

_LARGEST_INTEGER = 10**18


class _SectionMeta(ModelMetaclass):
    """Raise `ConfigError` when a section that is constructed in Python has a wrong setting."""

    if not TYPE_CHECKING:  # the signature of the class is that of its fields

        def __call__(self, *args: Any, **settings: Any) -> Any:
            if args:
                raise TypeError(f"{self.__name__} takes settings by keyword only, e.g. {_example(self)}.")
            try:
                return super().__call__(**settings)
            except ValidationError as error:
                raise ConfigError(_sentence(error, self, self.__name__)) from error


def _example(model: type[BaseModel]) -> str:
    """Return a call with the first setting of a section."""
    return f"{model.__name__}({next(iter(model.model_fields))}=...)"


class Section(BaseModel, metaclass=_SectionMeta):
    """One section of a configuration: unknown keys are refused, values are never converted."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


Share = Annotated[float, Field(ge=0.0, le=1.0)]
"""A share between 0 and 1."""
AnySection = TypeVar("AnySection", bound=BaseModel)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file into a dictionary.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    dict
        Tables and values by name.

    Raises
    ------
    InputError
        When the file is missing or empty.
    ConfigError
        When it is no TOML.
    """
    file = existing_file(path, "the configuration")
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except ValueError as error:  # no TOML, no UTF-8, or a number of thousands of digits
        raise ConfigError(f"{file} is not valid TOML ({error}); correct that place.") from error
    except RecursionError as error:
        raise ConfigError(f"{file} nests its values too deeply for a configuration; correct it.") from error


def refuse_newer_schema(values: Mapping[str, Any], known: int, where: str) -> None:
    """Refuse a file whose ``schema_version`` is newer than this program reads.

    Raises
    ------
    ConfigError
        A newer version; any other value is left to the checks of the configuration.

    Examples
    --------
    >>> refuse_newer_schema({"schema_version": 1}, 1, "mine.toml")
    """
    found = values.get("schema_version")
    if isinstance(found, int) and found > known:
        raise ConfigError(
            f"{where} has schema_version {found}, and this firnline reads version {known}; update firnline, or write the file "
            "again with firnline init."
        )


def with_overrides(values: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return a copy with ``section.key=value`` settings put in; values are read as TOML.

    Parameters
    ----------
    values : mapping
        Sections by name; not changed.
    overrides : sequence of str
        Settings as ``section.key=value``; what is no TOML value counts as text.

    Returns
    -------
    dict
        The sections with the settings.

    Examples
    --------
    >>> with_overrides({"planner": {"swaths": 4}}, ["planner.swaths=6"])
    {'planner': {'swaths': 6}}
    """
    result: dict[str, Any] = {
        key: dict(value) if isinstance(value, dict) else value for key, value in values.items()
    }
    for override in overrides:
        name, separator, text = override.partition("=")
        if not separator or not name.strip():
            raise ConfigError(f"the override {override!r} is not of the form section.key=value.")
        *sections, key = name.strip().split(".")
        place = result
        for section in sections:
            inner = place.get(section, {})
            if not isinstance(inner, dict):
                raise ConfigError(f"the override {override!r} goes through {section!r}, which is no section.")
            place[section] = dict(inner)
            place = place[section]
        place[key] = _toml_value(text.strip())
    return result


def _toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except ValueError:
        return text
    except RecursionError as error:
        raise ConfigError("the value of an override nests too deeply for a setting; correct it.") from error


def validated(model: type[AnySection], values: Mapping[str, Any], where: str) -> AnySection:
    """Build a configuration, or refuse with one sentence that names the key.

    Parameters
    ----------
    model : type of pydantic.BaseModel
        The configuration.
    values : mapping
        Settings by name.
    where : str
        Where they come from, for the message.

    Returns
    -------
    pydantic.BaseModel
        An instance of `model`.
    """
    try:
        _refuse_huge_integers(values, where)
        # TOML has lists only; in JSON mode they may stand for tuples, and nothing else is converted.
        return model.model_validate_json(json.dumps(values, default=str))
    except ValidationError as error:
        raise ConfigError(_sentence(error, model, where)) from error
    except RecursionError as error:
        raise ConfigError(f"{where} nests its values too deeply for a configuration; correct it.") from error


def _refuse_huge_integers(value: Any, where: str, key: str = "") -> None:
    """Refuse integers of more than 64 bits, which TOML does not have either."""
    if isinstance(value, int) and abs(value) > _LARGEST_INTEGER:
        raise ConfigError(
            f"{where}: {key} is an integer of {len(str(value))} digits; settings have at most 18, correct it."
        )
    inner = (
        value.items() if isinstance(value, Mapping) else enumerate(value if isinstance(value, list) else ())
    )
    for name, part in inner:
        _refuse_huge_integers(part, where, f"{key}.{name}" if key else str(name))


def _sentence(error: ValidationError, model: type[BaseModel], where: str) -> str:
    first = error.errors()[0]
    path = [str(part) for part in first["loc"]]
    key = ".".join(path)
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(path[-1], sorted(_all_keys(model)), n=1)
        hint = f"did you mean {near[0]}?" if near and near[0] != path[-1] else "remove it."
        return f"{where}: the key {key} is not known; {hint}"
    found = "" if first["type"] == "missing" or not key else f" (found {first['input']!r})"
    n_more = error.error_count() - 1
    more = {0: "", 1: "; 1 more setting is wrong"}.get(n_more, f"; {n_more} more settings are wrong")
    message = first["msg"].removeprefix("Value error, ").rstrip(".")
    place = f"{where}: {key}" if key else where
    return f"{place}: {message[:1].lower() + message[1:]}{found}{more}; correct it."


def _all_keys(model: type[BaseModel]) -> set[str]:
    keys: set[str] = set()
    for name, info in model.model_fields.items():
        keys.add(name)
        for kind in _models_in(info.annotation):
            keys |= _all_keys(kind)
    return keys


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [kind for part in getattr(annotation, "__args__", ()) for kind in _models_in(part)]
