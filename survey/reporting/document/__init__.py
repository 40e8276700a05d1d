"""Documents of sections with statements, tables and figures, written as HTML or PDF from one content."""

from survey.reporting.document.content import Chapter, Document, DrawnFigure, Table
from survey.reporting.document.writing import write_document

__all__ = ["Chapter", "Document", "DrawnFigure", "Table", "write_document"]
