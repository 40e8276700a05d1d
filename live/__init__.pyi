"""Public names and the modules that define them."""

from live.mission_transfer import downloaded_route as downloaded_route
from live.mission_transfer import upload as upload
