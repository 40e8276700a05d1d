"""KMZ files: the KML document in the archive, as Google Earth finds it."""

import zipfile
import zlib
from pathlib import Path

from survey.core.errors import CapacityError, InputError
from survey.core.files.library_messages import first_line
from survey.io.document_checks import LARGEST_TEXT_BYTES

# zipfile raises RuntimeError for an encrypted member and NotImplementedError for an unknown compression.
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError)


def kml_document(file: Path, what: str) -> bytes:
    """Return the first KML document of a KMZ file.

    Raises
    ------
    InputError
        No archive, a damaged or encrypted one, or one without a KML document.
    CapacityError
        A document that is too large to be parsed.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            member = next((m for m in archive.infolist() if m.filename.lower().endswith(".kml")), None)
            if member is None:
                raise InputError(
                    f"{what} {file} holds no KML document (doc.kml); save the placemarks as KMZ or KML again."
                )
            if member.file_size > LARGEST_TEXT_BYTES:
                raise CapacityError(
                    f"{what} {file} holds a document of {member.file_size:,} bytes; {LARGEST_TEXT_BYTES:,} can be "
                    "read as text, save it as GeoPackage."
                )
            return archive.read(member)
    except _DAMAGE as error:
        raise InputError(
            f"{what} {file} is damaged or no KMZ archive ({first_line(error)}); get it again."
        ) from error
