"""Algorithm of the Processing toolbox that runs one command of firnline."""

# Methods are named by QGIS.

import os
import queue
import re
import shutil
import subprocess
import threading
from pathlib import Path

from qgis.core import (
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingOutputString,
    QgsProcessingParameterCrs,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProcessingParameterVectorDestination,
    QgsProcessingParameterVectorLayer,
)

OUT, SUMMARY = "OUTPUT", "SUMMARY"
FORMATS = ["gpkg", "geojson", "kml", "shp"]
# QGIS sets these for its own Python and GDAL; another installation does not start with them.
FOREIGN = ("PYTHONHOME", "PYTHONPATH", "GDAL_DATA", "PROJ_LIB", "PROJ_DATA")
_NOT_MET = 5
_POLL_S = 0.1
_GEOMETRY = {
    "polygons": QgsProcessing.TypeVectorPolygon,
    "lines": QgsProcessing.TypeVectorLine,
    "points": QgsProcessing.TypeVectorPoint,
}


class CommandAlgorithm(QgsProcessingAlgorithm):
    """A command of the table; `place` returns where the program firnline is."""

    def __init__(self, command, place):
        super().__init__()
        self._command, self._place = command, place

    def createInstance(self):
        return CommandAlgorithm(self._command, self._place)

    def name(self):
        return self._command.name

    def displayName(self):
        return self._command.title

    def shortHelpString(self):
        return self._command.description

    def initAlgorithm(self, _configuration=None):
        for one in self._command.inputs:
            self.addParameter(_parameter(one))
        output = self._command.output
        if output is not None:
            self.addParameter(_destination(output))
        self.addOutput(QgsProcessingOutputString(SUMMARY, "Summary"))

    def processAlgorithm(self, parameters, context, feedback):
        words = [self._place(), *self._command.words]
        for one in self._command.inputs:
            value = self._value(one, parameters, context, feedback)
            words += [] if value is None else [one.option, value] if one.option else [value]
        results, output = {}, self._command.output
        if output is not None:
            results[OUT] = self._written(output, parameters, context)
            words += [output.option, results[OUT]] if output.option else [results[OUT]]
        results[SUMMARY] = run([*words, *self._command.flags], feedback)
        if output is not None:
            for title, file in output.layers:
                path = Path(results[OUT]) / file
                if path.exists():
                    details = QgsProcessingContext.LayerDetails(title, context.project(), title)
                    context.addLayerToLoadOnCompletion(str(path), details)
        return results

    def _value(self, one, parameters, context, feedback):
        """Return an input as the command takes it; None where it was left out."""
        if parameters.get(one.name) in (None, ""):
            return None
        if one.kind == "raster":
            return self.parameterAsRasterLayer(parameters, one.name, context).source()
        if one.kind in _GEOMETRY:
            return self.parameterAsCompatibleSourceLayerPath(
                parameters, one.name, context, FORMATS, FORMATS[0], feedback
            )
        if one.kind == "crs":
            return self.parameterAsCrs(parameters, one.name, context).authid()
        if one.kind == "number":
            return f"{self.parameterAsDouble(parameters, one.name, context):.12g}"
        return self.parameterAsString(parameters, one.name, context)

    def _written(self, output, parameters, context):
        """Return the path that the command writes."""
        if output.kind in _GEOMETRY:
            return self.parameterAsOutputLayer(parameters, OUT, context)
        return self.parameterAsString(parameters, OUT, context)


def run(words, feedback):
    """Run a program, show what it says and its progress, and return its output; end it where the user cancels."""
    if shutil.which(words[0]) is None:
        raise QgsProcessingException(
            f"the program {words[0]} was not found; install firnline, or set its place in Settings, Options, Processing, "
            "Providers, firnline."
        )
    feedback.pushCommandInfo(" ".join(words))
    environment = {name: value for name, value in os.environ.items() if name not in FOREIGN}
    process = subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8", env=environment
    )  # fmt: skip
    lines = queue.Queue()
    readers = [
        threading.Thread(target=_read, args=(stream, lines)) for stream in (process.stdout, process.stderr)
    ]
    for reader in readers:
        reader.start()
    said = {process.stdout: [], process.stderr: []}
    n_open = len(readers)
    while n_open:
        if feedback.isCanceled():
            process.terminate()
        try:
            stream, line = lines.get(timeout=_POLL_S)
        except queue.Empty:
            continue
        if line is None:
            n_open -= 1
            continue
        said[stream].append(line)
        _show(line, feedback)
    code = process.wait()
    if feedback.isCanceled():
        raise QgsProcessingException("the command was cancelled.")
    if code not in (0, _NOT_MET):
        sentences = [line for line in said[process.stderr] if line.startswith("firnline: ")]
        raise QgsProcessingException((sentences or said[process.stderr] or [f"exit code {code}"])[-1])
    return "\n".join(said[process.stdout])


def _read(stream, lines):
    """Put the lines of a stream into a queue, and None at its end."""
    for line in stream:
        lines.put((stream, line.rstrip()))
    lines.put((stream, None))


def _show(line, feedback):
    """Show a line, or the progress that it states."""
    progress = re.search(r": (\d+) of (\d+)", line)
    if progress and int(progress[2]):
        feedback.setProgress(100.0 * int(progress[1]) / int(progress[2]))
        feedback.setProgressText(line)
    else:
        feedback.pushInfo(line)


def _parameter(one):
    """Return the parameter of an input."""
    name, title, is_optional = one.name, one.title, one.is_optional
    if one.kind == "raster":
        return QgsProcessingParameterRasterLayer(name, title, optional=is_optional)
    if one.kind in _GEOMETRY:
        return QgsProcessingParameterVectorLayer(name, title, [_GEOMETRY[one.kind]], optional=is_optional)
    if one.kind == "file":
        return QgsProcessingParameterFile(name, title, optional=is_optional)
    if one.kind == "crs":
        return QgsProcessingParameterCrs(name, title, optional=is_optional)
    if one.kind == "number":
        kind = QgsProcessingParameterNumber.Double
        return QgsProcessingParameterNumber(name, title, kind, None, optional=is_optional)
    return QgsProcessingParameterString(name, title, optional=is_optional)


def _destination(output):
    """Return the parameter of what is written."""
    if output.kind in _GEOMETRY:
        return QgsProcessingParameterVectorDestination(OUT, output.title, _GEOMETRY[output.kind])
    if output.kind == "folder":
        return QgsProcessingParameterFolderDestination(OUT, output.title)
    return QgsProcessingParameterFileDestination(OUT, output.title, output.kind)
