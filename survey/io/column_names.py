"""Column names of survey tables: usual spellings, units in brackets, and mappings that a user names.

Readers of points and of time series share `SPELLINGS`, so that a spelling is added in one place. Names are compared in
lower case, with one underscore for anything that is neither letter nor digit, and without a unit of length at their end,
which the readers convert by. Of columns that mean the same, those in feet count only where there is no other.
"""

import logging
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, get_args

from survey.core import UNSTATED, ConfigError, InputError, printable
from survey.core.crs import ELLIPSOIDAL, known_datum
from survey.core.lengths import FOOT_M, US_SURVEY_FOOT_M, metres_in
from survey.core.time_units import without_time_unit
from survey.io.text_tables import Axis

SPELLINGS: Mapping[str, tuple[str, ...]] = {
    "x": ("x_m", "x", "x_coord", "x_coordinate", "point_x"),
    "y": ("y_m", "y", "y_coord", "y_coordinate", "point_y"),
    "easting": (
        "easting_m", "easting", "x_easting", "east_m", "east", "e", "grid_easting", "utm_easting", "utm_e",
        "este", "rechtswert", "ostwert", "est", "ost", "øst",
    ),
    "northing": (
        "northing_m", "northing", "y_northing", "north_m", "north", "n", "grid_northing", "utm_northing",
        "utm_n", "norte", "hochwert", "nordwert", "nord", "nord",
    ),
    "longitude": (
        "longitude_deg", "longitude", "x_longitude", "lon_deg", "lon", "lng", "long", "longitud",
        "longitude_wgs84", "gps_longitude", "longitudedegrees", "länge", "laenge", "geographic_longitude",
    ),
    "latitude": (
        "latitude_deg", "latitude", "y_latitude", "lat_deg", "lat", "latitud", "latitude_wgs84",
        "gps_latitude", "latitudedegrees", "breite", "geographic_latitude",
    ),
    "height": (
        "z_m", "z", "elevation", "height", "h", "altitude", "elevation_m", "height_m", "altitude_m",
        "elev", "elev_m", "alt", "alt_m", "ele", "z_coord", "z_coordinate", "point_z", "z_altitude",
        "z_elevation", "orthometric_height", "orthometric_height_m", "ortho_height", "ellipsoidal_height",
        "ellipsoidal_height_m", "ellipsoid_height", "ellip_height", "ell_height", "msl_height",
        "gps_altitude", "altitudemeters", "höhe", "hoehe", "altura", "cota", "høyde", "höjd", "quota",
        "hauteur", "ortho_elevation", "rl", "reduced_level", "ht", "ortho_ht", "orthometric_ht", "ellip_ht",
        "ellipsoid_ht", "ellipsoidal_ht", "ell_ht", "elv", "ground_elevation", "msl_elevation", "msl",
        "navd88_height", "navd88_elevation", "navd88_elev", "navd88",
    ),
    "sigma_z": (
        "sigma_z_m", "sigma_z", "sigma", "sigma_m", "sigma_u", "sigma_up", "sigma_v", "sdv", "sdv_m", "sdz", "sdz_m", "sdu",
        "sdu_m", "sd_v", "sd_z", "sd_u", "sd_up", "std_z", "std_u", "std_up", "std_v", "stdz", "vrms",
        "v_rms", "rms_v", "elevation_rms", "vertical_rms", "vertical_rms_m", "vertical_sd", "vertical_std",
        "vertical_precision", "vertical_precision_m", "vert_precision", "vert_prec", "vprec", "v_prec",
        "vertical_accuracy_m", "vertical_accuracy", "v_sd", "sd_height", "sd_elevation", "cq_1d",
        "cq_height", "cq_höhe", "v_prec_obs", "précision_z", "precision_z", "vacc", "v_acc",
        "verticalaccuracy", "v_accuracy", "z_accuracy", "accuracy_z", "σ",
    ),
    "sigma_xy": (
        "sigma_xy_m", "sigma_xy", "sdh", "sdh_m", "sd_h", "hrms", "h_rms", "rms_h", "horizontal_rms",
        "horizontal_rms_m", "horizontal_sd", "horizontal_std", "horizontal_precision",
        "horizontal_precision_m", "horz_prec", "hz_prec", "hprec", "h_prec", "horizontal_accuracy_m",
        "horizontal_accuracy", "lateral_rms", "hacc", "hacc_m", "h_acc", "h_acc_m", "accuracy",
        "accuracy_m", "accuracymeters", "h_sd", "cq_2d", "h_prec_obs", "horizontalaccuracy", "h_accuracy",
    ),
    "map_x": ("map_x_m", "map_x", "map_easting", "map_east", "map_e"),
    "map_y": ("map_y_m", "map_y", "map_northing", "map_north", "map_n"),
    "name": (
        "name", "point", "point_id", "pointid", "point_name", "point_number", "pt", "pt_id", "ptid", "id",
        "station", "pnt", "pt_no", "point_no", "punkt", "punktnummer", "punktnr", "punto", "nombre",
    ),
    "vegetated": ("vegetated",),
    "control": ("control",),
    "date": ("date", "datum", "fecha", "date_utc", "utc_date"),
    "time": (
        "time_s", "time", "t", "t_s", "timestamp", "timestamp_s", "time_stamp", "seconds", "elapsed_s",
        "utc_s", "unix_s", "unix_time", "epoch_s", "gps_time_s", "utc", "utc_time", "time_utc", "datetime",
        "date_time", "datetime_utc", "iso_time", "gps_time", "unix", "unixtime", "unixtimemillis", "epoch", "uhrzeit", "zeit", "datum_uhrzeit",
    ),
}  # fmt: skip
"""Normalized names of columns by what they hold; `spelled` shows how a header is compared with them."""

OWN_NAMES: Mapping[str, str] = {
    "x": "x_m", "y": "y_m", "z": "z_m", "lon": "longitude_deg", "lat": "latitude_deg",
    "sigma_z": "sigma_z_m", "sigma_xy": "sigma_xy_m", "map_x": "map_x_m", "map_y": "map_y_m",
    "name": "name", "vegetated": "vegetated", "control": "control", "time": "time_s",
}  # fmt: skip
"""Keys of a column mapping (``--columns x=Easting``), with the name that each column takes."""


# Names without a direction, which count where no other column has one.
_GENERAL = ("sigma", "σ")
_FEET = (FOOT_M, US_SURVEY_FOOT_M)
_LETTERS = {
    "p": "name",
    "n": "y_m",
    "y": "y_m",
    "e": "x_m",
    "x": "x_m",
    "z": "z_m",
    "s": "sigma_z_m",
    "d": "",
}


def normalize(name: str) -> str:
    """Return the form in which names of columns are compared.

    >>> normalize(" Easting [m]"), normalize("Point ID"), normalize("Elev.")
    ('easting_m', 'point_id', 'elev')
    """
    return re.sub(r"[\W_]+", "_", name.strip().lower()).strip("_")


def parse_columns(
    texts: Iterable[str], keys: Mapping[str, str] = OWN_NAMES, layout: str | None = None
) -> dict[str, str]:
    """Read a mapping such as ``x=Easting,y=Northing`` from the command line, and the order of columns that ``--format`` names.

    >>> parse_columns(["x=Easting,y=Northing", "sigma_z=SDV"])
    {'x_m': 'Easting', 'y_m': 'Northing', 'sigma_z_m': 'SDV'}
    >>> parse_columns(["sigma_z=6"], layout="pnezd")
    {'name': '1', 'y_m': '2', 'x_m': '3', 'z_m': '4', 'sigma_z_m': '6'}
    """
    found = {} if layout is None else _positions(layout)
    for pair in (pair for text in texts for pair in text.split(",") if pair.strip()):
        key, equals, column = (part.strip() for part in pair.partition("="))
        own = keys.get(key, key)
        if not equals or not column or own not in keys.values():
            raise ConfigError(
                f"the column mapping {pair.strip()!r} was not understood; key=column with one of the keys {', '.join(keys)} was expected."
            )
        if own in found or column in found.values():
            raise ConfigError(
                f"the column mapping names {pair.strip()!r} twice; give each key and column once."
            )
        found[own] = column
    return found


def _positions(layout: str) -> dict[str, str]:
    """Return own names with the number of the column that each letter of an order such as ``pnezd`` stands for."""
    found = {_LETTERS.get(letter): str(k) for k, letter in enumerate(layout.lower(), start=1)}
    if None in found or not {"x_m", "y_m", "z_m"} <= set(found) or len(found) < len(layout):
        raise ConfigError(
            f"--format is {layout[:20]!r}; the order of the columns was expected, such as pnezd, penz or xyz (p point, n northing, "
            "e easting, z height, d description, s standard deviation)."
        )
    return {own: place for own, place in found.items() if own}


def at_positions(given: Mapping[str, str], header: Sequence[str]) -> dict[str, str]:
    """Return a mapping of columns in which numbers that are no names stand for the columns at those positions.

    >>> at_positions({"z_m": "3"}, ["E", "N", "H"])
    {'z_m': 'H'}
    """
    return {own: header[int(name) - 1] if _is_position(name, header) else name for own, name in given.items()}


def last_position(given: Mapping[str, str]) -> int:
    """Return the number of the last column that a mapping names by its position alone; 0 where it names any otherwise.

    >>> last_position({"x_m": "2", "y_m": "3", "z_m": "4"}), last_position({"z_m": "H"})
    (4, 0)
    """
    are_numbers = {"x_m", "y_m", "z_m"} <= set(given) and all(name.isdecimal() for name in given.values())
    return max(map(int, given.values())) if are_numbers else 0


def _is_position(name: str, header: Sequence[str]) -> bool:
    return name not in header and name.isdecimal() and 1 <= int(name) <= len(header)


def spelled(name: str, kind: str) -> bool:
    """Return whether the name of a column is a usual one for a kind of value; a unit of length does not matter.

    >>> spelled("Easting (Meter)", "easting"), spelled("VRMS(mm)", "sigma_z"), spelled("Elevation (ft)", "height")
    (True, True, True)
    """
    bare = without_time_unit(normalize(name)) if kind == "time" else without_length(name)
    return normalize(name) in SPELLINGS[kind] or bare in SPELLINGS[kind]


def axis_of(name: str) -> Axis | None:
    """Return which angle a column holds by its name; None for metres and all else.

    >>> axis_of("Latitude"), axis_of("Easting")
    ('latitude', None)
    """
    return next((axis for axis in get_args(Axis) if spelled(name, axis)), None)


def without_length(name: str) -> str:
    """Return the normalized name of a column without a unit of length at its end.

    >>> without_length("Easting [Meter]"), without_length("Elev US survey ft"), without_length("SDV (mm)"), without_length("m")
    ('easting', 'elev', 'sdv', 'm')
    """
    plain = normalize(name)
    unit = _unit_in(plain)
    return plain if unit is None else plain.removesuffix(f"_{unit}")


def stated_length(name: str) -> float | None:
    """Return the metres of the unit of length at the end of a column's name; None where it names none.

    >>> stated_length("SDV (mm)"), stated_length("Elevation (ft)"), stated_length("z_m"), stated_length("Elevation")
    (0.001, 0.3048, 1.0, None)
    """
    unit = _unit_in(normalize(name))
    return None if unit is None else metres_in(unit)


def _unit_in(plain: str) -> str | None:
    """Return the longest part at the end of a normalized name that is a unit of length."""
    parts = plain.split("_")
    ends = ("_".join(parts[k:]) for k in range(1, len(parts)))
    return next((end for end in ends if metres_in(end) is not None), None)


def metres_first(names: Sequence[str]) -> list[str]:
    """Return the columns that are not in feet, or all where there is no other.

    >>> metres_first(["Elevation (ft)", "Elevation (m)"]), metres_first(["Elevation (ft)"])
    (['Elevation (m)'], ['Elevation (ft)'])
    """
    return [name for name in names if stated_length(name) not in _FEET] or list(names)


class ColumnNames(NamedTuple):
    """Columns of a file by own name, and the columns that are not used."""

    columns: dict[str, str]
    unused: tuple[str, ...] = ()

    @property
    def are_own(self) -> bool:
        """Whether every column that is used has its own name in the file."""
        return all(own == name for own, name in self.columns.items())

    def sentence(self, where: str) -> str:
        """State which columns were read, and which were not.

        >>> ColumnNames({"x_m": "Easting"}, ("Code",)).sentence("gnss.csv")
        'gnss.csv: columns read as x_m = Easting; not used: Code.'
        """
        read = ", ".join(f"{own} = {name}" for own, name in self.columns.items())
        rest = f"; not used: {', '.join(self.unused)}" if self.unused else ""
        return printable(f"{where}: columns read as {read}{rest}.")


def rename_header(header: Sequence[str], given: Mapping[str, str], where: str) -> list[str]:
    """Give columns that a mapping names their own names; a column that has such a name already loses it.

    >>> rename_header(["E", "N", "H", "z_m"], {"z_m": "H"}, "gnss.csv")
    ['E', 'N', 'z_m', '(z_m)']
    """
    missing = next((name for name in given.values() if name not in header), None)
    if missing is not None:
        raise InputError(
            f"{where} has no column {missing!r} (found {printable(', '.join(header))[:200]}); name one of those."
        )
    own = {name: key for key, name in given.items()}
    return [own.get(name, f"({name})" if name in given else name) for name in header]


def one_column(kind: str, header: Sequence[str], where: str) -> str | None:
    """Return the column that holds one kind of value, by its usual spellings; None where there is none.

    >>> one_column("sigma_z", ["Point", "Easting", "SDH", "SDV"], "gnss.csv")
    'SDV'
    >>> one_column("sigma_z", ["E", "N", "H", "Sigma", "SDV"], "gnss.csv")
    'SDV'
    """
    own = SPELLINGS[kind][0]
    found = metres_first([name for name in header if spelled(name, kind)])
    found = [name for name in found if without_length(name) not in _GENERAL] or found
    if own in found or len(found) < 2:
        return own if own in found else next(iter(found), None)
    key = next((short for short, long in OWN_NAMES.items() if long == own), kind)
    raise InputError(
        f"{where} has the columns {' and '.join(found)}, and either could be meant; choose one with --columns {key}={found[0]}."
    )


def datum_of_column(name: str) -> str:
    """Return the vertical datum that the name of a column of heights states, ``""`` for none.

    >>> datum_of_column("Ellipsoidal height"), datum_of_column("NAVD88 elev (ft)"), datum_of_column("Elevation")
    ('ellipsoidal height', 'NAVD88 height', '')
    """
    if re.search(r"(^|_)ell(ip|_)", normalize(name)):
        return ELLIPSOIDAL
    return known_datum(name) or UNSTATED


def metres_factor(name: str) -> float:
    """Return the factor to metres that the unit in the name of a column asks for.

    >>> metres_factor("SDV (mm)"), metres_factor("Elevation [m]"), metres_factor("Elevation")
    (0.001, 1.0, 1.0)
    """
    return stated_length(name) or 1.0


def log_columns(where: str, names: ColumnNames) -> None:
    """Log which columns were read, where their names are not firnline's own."""
    if not names.are_own:
        logging.getLogger(__name__).warning("%s", names.sentence(where))
