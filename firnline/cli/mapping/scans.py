"""``firnline reconstruct SCANS --method carving|emap|field``: a map from LiDAR scans, one by one."""

import survey
from firnline.cli.mapping.inputs import MapRequest
from firnline.cli.mapping.outputs import MadeMap
from firnline.cli.progress import counted
from survey.core.crs import projected_crs
from survey.core.errors import InputError
from survey.interchange.scans import SensorPath, read_scans, scan_files
from survey.reconstruction.mapping import within
from survey.reconstruction.method import ScanSettings
from survey.reconstruction.scan_map import map_scans


def map_scan_files(request: MapRequest) -> MadeMap:
    """Map scans as they are read, over the area or over all that they show."""
    files = scan_files(request.options.sources)
    track = next((SensorPath.read(file) for file in request.options.trajectories), None)
    area = _area(request)
    grid = None if area is None else request.grid_over(area.bounds, area.crs)
    config = request.config
    settings = ScanSettings(request.step_m, rays=config.rays, configs=config.configs_of(request.method))
    with counted(quiet=request.options.quiet) as progress:
        made = map_scans(
            read_scans(files, crs=request.options.crs, sigma_m=request.options.sigma_m, track=track),
            request.method,
            settings,
            grid=grid,
            on_scan=lambda n: progress("scans", n, max(len(files), n)),
        )
    result = made.reconstruction if area is None else within(made.reconstruction, area)
    return MadeMap(result, f"from {made.n_scans} scans", request.options.area)


def _area(request: MapRequest) -> survey.SurveyArea | None:
    """Return the area to map; scans state their CRS one by one, so that --crs or the area's own counts."""
    if request.options.area is None:
        return None
    if request.options.crs is None:
        area = survey.SurveyArea.read(request.options.area)
        if not area.crs.is_projected:
            raise InputError(f"{request.options.area} is in degrees; add --crs with the CRS of the scans.")
        return area
    return request.read_area(projected_crs(request.options.crs, "the scans"))
