"""``python -m uvms_mj`` is ``uvms-mj``."""

from .cli import main

main()
