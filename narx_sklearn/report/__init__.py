"""The report of a diagnosis as one self-contained HTML file."""

from narx_sklearn.report._render import render_report, write_report

__all__ = ["render_report", "write_report"]
