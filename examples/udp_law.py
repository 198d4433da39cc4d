"""A law of your own program, in another process: PD about the reference.

    python udp_law.py                                       in one terminal
    uvms-mj run --controller udp controller.period=1e-3     in another one

Any language will do: a request is 8 bytes "uvms-mj1", the number of the instant (uint64) and the record of signals
(struct signals of uvms_stage.h); the answer is the number of the instant and six doubles, all little endian.
"""

import sys

from uvms_mj.control.base import PORT
from uvms_mj.engine.udp import LOOPBACK, serve


def law(signals):
    return signals.g_hat - 200.0 * signals.eta_e - 150.0 * signals.nu_e


if __name__ == "__main__":
    host = sys.argv[2] if len(sys.argv) > 2 else LOOPBACK  # 0.0.0.0 for a run on another machine
    serve(law, int(sys.argv[1]) if len(sys.argv) > 1 else PORT, host=host)
