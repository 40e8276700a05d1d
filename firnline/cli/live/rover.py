"""``firnline rover``: a simulated rover behind MAVSDK's servers."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.live.options import needs_live_extra
from firnline.cli.outcome import with_exit_codes


@with_exit_codes
def rover(
    dem: Annotated[
        Path | None, typer.Option("--dem", help="Elevation raster of the ground that it measures.")
    ] = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="UDP port on 127.0.0.1; 0 for a free one.")
    ] = 14550,
    speed_m_s: Annotated[float, typer.Option("--speed", min=0.01, help="Speed [m/s].")] = 1.0,
    range_m: Annotated[
        float, typer.Option("--range", min=1.0, help="Distance of one battery charge [m].")
    ] = 12_000.0,
    loss: Annotated[
        float, typer.Option("--loss", min=0.0, max=0.99, help="Share of packets that the radio loses.")
    ] = 0.0,
    hasten: Annotated[
        float, typer.Option("--hasten", min=0.1, help="Seconds of driving in one second.")
    ] = 1.0,
    seed: Annotated[
        int, typer.Option("--seed", help="Seed of the errors of fixes and the losses of packets.")
    ] = 0,
) -> None:
    """Simulate a rover that missions can be uploaded to, in this process, until Ctrl+C.

    It follows its waypoints at constant speed from the first one on, stops at its fence, and reports fixes with drawn
    errors, attitude and battery. MAVSDK's servers hold its mission and its fence. Needs firnline[live].

    For example:

      firnline rover --dem srtm.tif --hasten 10
    """
    with needs_live_extra():
        import survey
        from live.rover import Radio, RoverSettings, serve_rover

        terrain = None if dem is None else survey.Dem.read(dem)
        radio = Radio("127.0.0.1", port, loss, seed)
        typer.echo(f"the rover listens at udp://127.0.0.1:{radio.port}")
        settings = RoverSettings(speed_m_s=speed_m_s, range_m=range_m, seed=seed)
        serve_rover(radio, settings, terrain, hasten=hasten)
