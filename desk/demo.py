"""Sample site of the desk: real elevations, with an area on a flank."""

from pathlib import Path

from desk.plan.document import PlanDocument
from desk.plan.history import SUFFIX, StoredHistory
from survey.data.area import SurveyArea

_NAME = "srtm_sample"


def write_demo(folder: Path) -> Path:
    """Write the sample terrain and a plan to begin with; what is there already stays.

    Parameters
    ----------
    folder : pathlib.Path
        Where; it is created.

    Returns
    -------
    pathlib.Path
        File of the plan.
    """
    from survey.terrain.real import real_sample, sample_site

    folder.mkdir(parents=True, exist_ok=True)
    terrain, plan_file = folder / f"{_NAME}.tif", folder / f"{_NAME}{SUFFIX}"
    if not terrain.exists():
        real_sample().write(terrain)
    if not plan_file.exists():
        site = sample_site()
        xmin, ymin, xmax, ymax = site.bounds
        area = SurveyArea.rectangle((xmin - 200.0, ymin - 200.0, xmax + 200.0, ymax + 200.0), site.prior.crs)
        document = PlanDocument.of_area(area).model_copy(update={"starts": ((xmin - 150.0, ymin - 150.0),)})
        StoredHistory(plan_file, terrain.name, document).write()
    return plan_file
