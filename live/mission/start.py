"""Start of the mission that a vehicle holds."""

from time import monotonic

from live.link.vehicle import LinkLostError, Vehicle
from survey.core.errors import InputError

_ARM, _START = 400, 300
_ACCEPTED, _IN_PROGRESS = 0, 5
_RESEND_S = 1.0


def start_mission(vehicle: Vehicle) -> None:
    """Arm a vehicle and start its mission: it drives off.

    Parameters
    ----------
    vehicle : Vehicle
        That holds a mission.

    Raises
    ------
    InputError
        The vehicle refuses to be armed or to start.
    LinkLostError
        The vehicle is silent.
    """
    _command(vehicle, _ARM, 1.0, "be armed")
    _command(vehicle, _START, 0.0, "start its mission")


def _command(vehicle: Vehicle, command: int, first: float, words: str) -> None:
    """Send a command until it is accepted."""
    began, confirmation = monotonic(), 0
    while monotonic() - began < vehicle.patience_s:
        others = (0.0,) * 6
        vehicle.mav.command_long_send(
            vehicle.system, vehicle.component, command, min(confirmation, 255), first, *others
        )
        confirmation += 1
        answer = vehicle.receive(("COMMAND_ACK",), _RESEND_S)
        if answer is None or answer.command != command or answer.result == _IN_PROGRESS:
            continue
        if answer.result == _ACCEPTED:
            return
        raise InputError(
            f"{vehicle.name} refused to {words} (MAV_RESULT {answer.result}); look at it in your ground station."
        )
    raise LinkLostError(
        f"{vehicle.address.text} did not answer the order to {words} for {vehicle.patience_s:g} s; restore the link."
    )
