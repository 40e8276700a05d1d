"""Surveys while they are driven: missions of rovers over MAVLink, and the map as measurements arrive."""
