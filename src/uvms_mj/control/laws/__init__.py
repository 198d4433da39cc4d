"""Laws. A law imports its theory when it is asked for it, so that a log is read without."""
