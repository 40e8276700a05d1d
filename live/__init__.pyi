"""Public names and the modules that define them."""

from live.mission.download import downloaded_route as downloaded_route
from live.mission.upload import upload as upload
from live.watch.survey_watch import SurveyWatch as SurveyWatch
