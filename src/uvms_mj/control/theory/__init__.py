"""Theory: the rest of a law in closed form, what sampling and delays do to it, certificates."""
