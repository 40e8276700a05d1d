"""``firnline payload``: map a quantity that was logged on a drive."""

from firnline.actions.requests import PayloadRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Quiet, print_result, with_options_of


@with_exit_codes
@with_options_of(PayloadRequest)
def payload(request: PayloadRequest, dry_run: DryRun = False, quiet: Quiet = False) -> None:
    """Map a quantity that was logged on a drive: a Gaussian process with elevation as covariate.

    For example:

      firnline payload weather.csv --name air_temperature --unit degC --lag 8 --trajectory localization/trajectory.csv --terrain map/dem.tif

      firnline payload albedo.csv --name albedo --unit 1 --terrain dem.tif --out albedo
    """
    from firnline.actions import mapping

    if dry_run:
        print_result(mapping.preview_payload(request))
    else:
        print_result(mapping.payload(request).write(), quiet=quiet)
