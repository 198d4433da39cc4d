"""Other programs that command the plant in lockstep: the plant owns time, and nothing waits for a wall clock."""
