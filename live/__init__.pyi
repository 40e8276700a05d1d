"""Public names and the modules that define them."""

from live.mission.vehicle_mission import downloaded_route as downloaded_route
from live.mission.vehicle_mission import upload as upload
