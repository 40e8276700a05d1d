"""Parameters, results, lines of facts, and checks of files: what all actions have in common.

A request is a frozen dataclass whose fields are annotated by `Argument` and `Option`; the command line takes its
options from them, so that each parameter is declared once. An action reads and checks what a request names, computes, and
returns a `Result`, which writes files, states what was found, and prints nothing. Outputs are checked before any work
starts. Rasters are read about an area, in its CRS, and warped where they are in degrees.
"""

import json
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar, get_type_hints

import survey
from survey.core import ConfigError, FirnlineError, InputError, duration_text, length_text
from survey.core.files import existing_file

if TYPE_CHECKING:
    from pyproj import CRS

    from survey.core.arrays import Bounds, FloatArray

Progress = Callable[[str, int, int], None]
"""Called with what is done, how many are done, and how many there are."""
Action = TypeVar("Action", bound=Callable[..., "Result"])
_LEAST_MARGIN_M = 200.0
_MARGIN_CELLS = 4.0
_DRY_RUN = "nothing was written (--dry-run)"


def no_progress(what: str, done: int, total: int) -> None:
    """Report nothing."""


def place_of(text: str, option: str) -> "FloatArray":
    """Return easting and northing (2,) [m] of a text with a comma between."""
    import numpy as np

    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise ConfigError(
            f"{option} {text!r} is no place; give easting and northing in metres with a comma between, such as 500010,6700020."
        )
    return place


class Parameter:
    """Spellings, help and limits of a field of a request.

    `names`: spellings on the command line, such as ``--prior``. `reads`: what the file that it names is called where it does
    not exist, such as "the raster", or that for files with a suffix; empty for what is no such file. `settings`: ``help``,
    ``metavar``, ``min`` and ``max``.
    """

    def __init__(self, *names: str, reads: str | Mapping[str, str] = "", **settings: Any) -> None:
        self.names = names
        self.reads = reads
        self.settings = settings

    def kind_of(self, file: Path) -> str:
        """Return what a file that the field names is called; empty where nothing is known of it."""
        return self.reads if isinstance(self.reads, str) else self.reads.get(file.suffix.lower(), "")

    @property
    def help(self) -> str:
        """What the field means."""
        return str(self.settings["help"])


class Argument(Parameter):
    """Field that is given by its position on the command line."""


class Option(Parameter):
    """Field that is given by its name on the command line."""


def require_inputs(request: Any) -> None:
    """Refuse a request that names a file which does not exist, as its reader would, before anything is loaded to read it."""
    for name, hint in get_type_hints(type(request), include_extras=True).items():
        marks = [mark for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, Parameter)]
        value = getattr(request, name)
        named = value if isinstance(value, list) else [value]
        for file in (one for one in named if marks and isinstance(one, Path)):
            kind = marks[0].kind_of(file)
            if kind and not os.path.exists(file):  # noqa: PTH110  # never raises, unlike that of pathlib
                existing_file(file, kind)


class NotMetError(FirnlineError):
    """A class or error that was required and cannot be reached."""

    exit_code = 5


class Result(ABC):
    """Result of an action."""

    def write(self) -> Self:
        """Write the files that are not written while the action computes.

        Returns
        -------
        Result
            The result with its files.
        """
        return self

    @abstractmethod
    def lines(self) -> list[str]:
        """Return what was found as lines for people.

        Returns
        -------
        list of str
            Without line feeds.
        """

    def facts(self) -> dict[str, Any]:
        """Return what was found as plain values.

        Returns
        -------
        dict
            By machine names with units, such as ``rmse_m``.
        """
        return {}

    def as_json(self) -> str:
        """Return the facts as JSON.

        Returns
        -------
        str
            As ``--json`` prints them.
        """
        return json.dumps(self.facts(), indent=2)

    @property
    def notes(self) -> list[str]:
        """Sentences about what was left out or assumed."""
        return []

    @property
    def is_met(self) -> bool:
        """Whether the class that was required is met."""
        return True


@dataclass(frozen=True)
class WrittenResult(Result):
    """Result whose files are written after it was computed.

    `request`: request that names the files.
    """

    request: Any

    def write(self, out: Path | None = None) -> Self:
        """Write the files; all replace what was there, or none does.

        Parameters
        ----------
        out : pathlib.Path, optional
            File or folder; that of the request by default.

        Returns
        -------
        WrittenResult
            The result at its place.
        """
        placed = self if out is None else replace(self, request=self._request_at(out))
        placed._write_files()
        return placed

    def _request_at(self, out: Path) -> Any:
        """Return the request with another place."""
        return replace(self.request, out=out)

    @abstractmethod
    def _write_files(self) -> None:
        """Write the files that the request names."""


@dataclass(frozen=True)
class Preview(Result):
    """What an action would do with the input that was checked.

    Parameters
    ----------
    writes : tuple of pathlib.Path
        Files and folders that it would write.
    stated : mapping of str to object
        What was read, by name.
    left_out : tuple of str
        Sentences about what would be left out.
    """

    writes: tuple[Path, ...]
    stated: Mapping[str, object] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        writes: Iterable[Path],
        stated: Mapping[str, object] | None = None,
        left_out: tuple[str, ...] = (),
    ) -> "Preview":
        """Return the preview of files and facts."""
        return cls(tuple(writes), stated or {}, left_out)

    @property
    def notes(self) -> list[str]:
        """What would be left out."""
        return list(self.left_out)

    def lines(self) -> list[str]:
        """Return what was read and what would be written."""
        files = ", ".join(str(path) for path in self.writes)
        stated = [fact_line(name, value) for name, value in self.stated.items()]
        return [*stated, fact_line("would write", files or "no file"), _DRY_RUN]


def previewed_by(preview: Callable[[Any], Preview]) -> Callable[[Action], Action]:
    """Give an action the function that checks its input and returns what it would do."""

    def named(action: Action) -> Action:
        vars(action)["preview"] = preview
        return action

    return named


def preview_of(action: Callable[..., Result], request: Any) -> Preview:
    """Check the input of an action, and return what it would do."""
    made: Preview = vars(action)["preview"](request)
    return made


@contextmanager
def needs_live_extra() -> Iterator[None]:
    """Turn a missing package into a sentence that names the extra."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"this command needs {error.name}, which is not installed; install firnline[live]."
        ) from error


_WIDTH = 18
_NAMES = {
    "n": "points", "std": "standard deviation", "worst": "largest error",
    "horizontal rms": "horizontal RMS error", "vertical rms": "vertical RMS error",
    "end sigma": "σ at the end", "yaw rms": "heading RMS error", "ate se3": "RMS, aligned",
    "ate sim3": "RMS, scaled",
}  # fmt: skip
_WORDS = {"rmse": "RMSE", "nmad": "NMAD", "p95": "95 % below", "rpe": "relative error", "nees": "NEES"}
_UNITS = {"m": "{:.3f} m", "m2": "{:.4g} m²", "deg": "{:.2f}°", "per_cent": "{:.2f} %"}
# A unit ends a name, or stands before the number of one of several.
_UNIT = re.compile(r"_(m2|m|s|deg|per_cent)(?=(_\d+)?$)")


def fact_line(name: str, value: object) -> str:
    """Return one fact: its name, padded to the width of the column, and its value.

    >>> fact_line("length", "4.09 km")
    '  length             4.09 km'
    """
    return f"  {name:<{_WIDTH}} {value}"


def figure_lines(figures: Mapping[str, Any]) -> list[str]:
    r"""Return figures with machine names, such as ``rmse_m``, as facts with units.

    >>> print("\n".join(figure_lines({"rmse_m": 0.04661, "length_m": 4093.2, "time_s": 4140.0, "n": 36})))
      RMSE               0.047 m
      length             4.09 km
      time               1 h 09 min
      points             36
    """
    return [fact_line(_title(name), _value(name, value)) for name, value in figures.items()]


def _title(name: str) -> str:
    """Return a machine name in words, without its unit."""
    words = _UNIT.sub("", name.replace("_per_s", " per second")).replace("_", " ")
    return _NAMES.get(words, " ".join(_WORDS.get(word, word) for word in words.split()))


def _value(name: str, value: Any) -> str:
    """Return a value with the unit that its name ends in."""
    if not isinstance(value, float):
        return str(value)
    if name.endswith("length_m"):
        return length_text(value)
    found = _UNIT.search(name.replace("_per_s", ""))
    unit = "" if found is None else found.group(1)
    return duration_text(value) if unit == "s" else _UNITS.get(unit, "{:.4g}").format(value)


def refuse_existing(
    outputs: Iterable[Path], *, force: bool, inputs: Iterable[Path | None] = (), own: Collection[str] = ()
) -> None:
    """Refuse outputs that exist, that are inputs, or that cannot be written."""
    from survey.core.replacement import refuse_unwritable, resolved

    given = [resolved(path) for path in inputs if path is not None]
    for output in outputs:
        _refuse_input(output, given)
        refuse_unwritable(output, is_folder=bool(own))
        _refuse_present(output, force=force, own=own)


def with_companions(inputs: Iterable[Path | None]) -> list[Path]:
    """Return input files with the files beside them that are read too (``.prj``, ``.dbf`` …)."""
    from survey.io.dataset_files import companion_files

    found: list[Path] = []
    for path in inputs:
        if path is None:
            continue
        found.append(path)
        if path.is_file() and path.stat().st_size:
            found += companion_files(path)
    return found


def companions_of_output(output: Path) -> list[Path]:
    """Return the files that a format of several files has beside its main file.

    Returns: for ``.asc`` the ``.prj``, for ``.shp`` the tables, index and CRS, for worlds their pictures and material;
    none for other formats.
    """
    suffixes = {
        ".asc": (".prj",),
        ".shp": (".shx", ".dbf", ".prj", ".cpg"),
        ".sdf": (".heightmap.png", ".texture.png", ".normal.png"),
        ".obj": (".mtl", ".texture.png"),
    }.get(output.suffix.lower(), ())
    return [output.with_suffix(suffix) for suffix in suffixes]


def _refuse_input(output: Path, inputs: Iterable[Path]) -> None:
    from survey.core.replacement import resolved

    place = resolved(output)
    for path in inputs:
        if path == place or place in path.parents:
            raise InputError(
                f"the output {output} is or contains the input {path}; choose another place for the output."
            )


def _refuse_present(output: Path, *, force: bool, own: Collection[str]) -> None:
    from survey.core.replacement import refuse_foreign

    if not os.path.lexists(output):
        return
    is_folder = output.is_dir()
    if not force and not (is_folder and not any(output.iterdir())):
        raise InputError(f"{output} exists; choose another name or add --force to replace it.")
    if own:
        refuse_foreign(output, own)
    elif is_folder:
        raise InputError(f"{output} is a folder, and a file was to be written; choose another name.")


def own_crs(path: Path) -> "CRS | None":
    """Return the projected CRS that a raster's header names; None where it is in degrees."""
    from survey.core.crs import projected_crs
    from survey.core.transformation import is_geographic
    from survey.io.raster import raster_header

    stated = raster_header(path).crs
    return None if is_geographic(stated) else projected_crs(stated, str(path))


def area_if_named(file: Path | None, options: Any, crs: Any) -> "survey.SurveyArea | None":
    """Return `chosen_area`, or None without a file; refuse options that choose ground of none."""
    if file is not None:
        return chosen_area(file, options, crs)
    if options.select or _has_limits(options):
        raise InputError("--select, --above and --below choose ground of an area; add --area with its file.")
    return None


def chosen_area(file: Path, options: Any, crs: Any) -> "survey.SurveyArea":
    """Read the outlines that the options select, and cut them to the heights of the prior that they state."""
    if _has_limits(options) and options.prior is None:
        raise InputError(
            "--above and --below count from the heights of a prior; add --prior with its raster."
        )
    area = survey.SurveyArea.read(file, crs=crs, select=options.select)
    if not _has_limits(options):
        return area
    from planners.routes.traversability import between_heights

    heights = read_about(options.prior, area.bounds, area.crs, "the prior", units=options.units)
    return between_heights(area, heights, above_m=options.above, below_m=options.below)


def _has_limits(options: Any) -> bool:
    return any(getattr(options, name, None) is not None for name in ("above", "below"))


def read_about(
    path: Path, bounds: "Bounds", crs: "CRS", what: str, *, mask: bool = False, units: str | None = None
) -> "survey.Dem":
    """Read the cells of a raster on bounds [m] and about them, as far as slopes and cameras reach."""
    from planners.capacity import require_cells
    from survey.core.crs import same_crs
    from survey.io.raster.warping import cell_m

    stated = own_crs(path)
    if stated is not None:
        same_crs(crs, stated, f"the survey area and {what}")
    west, south, east, north = bounds
    step_m = cell_m(path, crs)
    if step_m > 0.0:  # a turned raster is refused when it is read
        require_cells(int((east - west) * (north - south) / step_m**2))
    margin_m = max(_MARGIN_CELLS * step_m, _LEAST_MARGIN_M)
    about = (west - margin_m, south - margin_m, east + margin_m, north + margin_m)
    return survey.Dem.read(path, crs=crs if stated is None else None, bounds=about, mask=mask, units=units)
