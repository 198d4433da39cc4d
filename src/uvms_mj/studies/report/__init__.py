"""The report of a study: one self-contained HTML page of a plan and its rows."""

from .page import page as page
