"""Numbers in, pages out: the report of an evaluation, two runs beside each other, and many as a gallery."""

from lightprobe.report.pictures import view_pictures
from lightprobe.report.report import Report, evenly_spaced, write_report

__all__ = ["Report", "evenly_spaced", "view_pictures", "write_report"]
