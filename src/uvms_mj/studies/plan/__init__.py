"""The plan of a study: its file is read and checked, its points are drawn, and its runs are listed."""

from .plan import Plan as Plan
from .plan import Run as Run
