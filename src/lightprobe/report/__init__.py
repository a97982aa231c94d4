"""Numbers in, pages out: the report of an evaluation, a benchmark's records and their tables, and how each was made."""

from lightprobe.report.pictures import view_pictures
from lightprobe.report.report import Report, spread, write_report

__all__ = ["Report", "spread", "view_pictures", "write_report"]
