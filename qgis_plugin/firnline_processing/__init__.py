"""Plugin of QGIS that adds the commands of firnline to the Processing toolbox."""


def classFactory(_iface):
    """Return the plugin."""
    from .provider import Plugin

    return Plugin()
