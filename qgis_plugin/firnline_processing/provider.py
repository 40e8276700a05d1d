"""Provider of the Processing toolbox, and the plugin that adds it."""

# Methods are named by QGIS.

import shutil

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider

from .algorithm import CommandAlgorithm
from .commands import COMMANDS

PLACE = "FIRNLINE_COMMAND"


class FirnlineProvider(QgsProcessingProvider):
    """Algorithms that call the installed program firnline."""

    def id(self):
        return "firnline"

    def name(self):
        return "firnline"

    def load(self):
        found = shutil.which("firnline") or "firnline"
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        ProcessingConfig.addSetting(
            Setting(self.name(), PLACE, "Program firnline", found, valuetype=Setting.FILE)
        )
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self):
        ProcessingConfig.removeSetting(PLACE)

    def loadAlgorithms(self):
        for command in COMMANDS:
            self.addAlgorithm(CommandAlgorithm(command, lambda: ProcessingConfig.getSetting(PLACE)))


class Plugin:
    """What QGIS loads."""

    def __init__(self):
        self._provider = None

    def initProcessing(self):
        self._provider = FirnlineProvider()
        QgsApplication.processingRegistry().addProvider(self._provider)

    def initGui(self):
        self.initProcessing()

    def unload(self):
        QgsApplication.processingRegistry().removeProvider(self._provider)
