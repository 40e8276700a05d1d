"""A route format: plain lines of coordinates."""

from tests.docs.recipes.recipe import Recipe

ROUTE_FORMAT = Recipe(
    "Add a route format",
    2,
    inserted={
        "survey/interchange/route_writers.py": (
            (
                "\n\nWRITERS: dict[",
                "\n\ndef _write_poly(route: Route, path: Path, _: Surroundings) -> None:\n"
                '    write_text(path, "\\n".join("".join(f"{x:.4f} {y:.4f}\\n" for x, y in leg.xy) for leg in route.legs))\n',
            ),
            ('    ".waypoints": write_wpl', '    ".poly": _write_poly,\n'),
        ),
        "survey/interchange/route_readers.py": (
            (
                "def _read_mission_file",
                "def _read_poly(path: Path, _: CRS) -> ReadLegs:\n"
                '    parts = path.read_text(encoding="utf-8").strip().split("\\n\\n")\n'
                '    return ReadLegs(_joined([Leg("swath", np.array([line.split() for line in part.splitlines()], float)) for part in parts]))\n\n\n',
            ),
            ('    ".waypoints": _read_mission_file', '    ".poly": _read_poly,\n'),
            ('".wkt")\n', '".poly", '),
        ),
    },
    check="""
from firnline import LawnmowerConfig, Route, SurveyArea, plan
area = SurveyArea.rectangle((500_000.0, 6_700_000.0, 500_200.0, 6_700_200.0), "EPSG:32608")
plan(area, None, LawnmowerConfig(swaths=3)).write("route.gpkg")
command("export", "route.gpkg", "out.poly")
command("export", "out.poly", "back.gpkg", "--crs", "EPSG:32608")
assert abs(Route.read("back.gpkg").ground_length_m - Route.read("route.gpkg").ground_length_m) < 0.01
""",
)
