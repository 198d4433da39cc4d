"""Figures of traces: the paper's figures 1-12, and the same quantities of any log.

The style file ``uvms_mj.mplstyle`` defines fonts, widths and colours. A signal has the same colour in every figure.
References and expected values are black.
"""

from .compose import RUNS, WHATS, paper, plot
from .panels import SWITCHING_S
from .style import FONTS, FORMATS, WIDTHS, save, typeset

__all__ = ["FONTS", "FORMATS", "RUNS", "SWITCHING_S", "WHATS", "WIDTHS", "paper", "plot", "save", "typeset"]
