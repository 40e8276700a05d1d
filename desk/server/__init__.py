"""Server of the planning desk: routes, checks of requests, files of the page."""
