"""Public names and the modules that define them."""

from live.mission.download import downloaded_route as downloaded_route
from live.mission.upload import upload as upload
