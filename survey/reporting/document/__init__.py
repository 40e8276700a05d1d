"""Documents of sections with statements, tables and figures, written as HTML or PDF from one content."""

from survey.reporting.document.content import Document, DrawnFigure, Section, Table
from survey.reporting.document.writing import write_document

__all__ = ["Document", "DrawnFigure", "Section", "Table", "write_document"]
