"""A law's library: the control system of a scenario, from measurements to thrusts and pulses, as a library in C for the
processor of a vehicle, with a test that compares it with recorded steps of the run."""
