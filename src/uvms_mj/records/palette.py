"""The palette of Okabe and Ito, which colour-blind readers can distinguish: red, green and blue, 0 to 255."""

Colour = tuple[int, int, int]
ORANGE, SKY, GREEN = (230, 159, 0), (86, 180, 233), (0, 158, 115)
YELLOW, BLUE, VERMILLION, PURPLE = (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167)
