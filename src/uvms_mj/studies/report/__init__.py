"""The report of a study: one self-contained HTML page of a plan and its rows, and its figures one by one."""

from .page import figure as figure
from .page import page as page
