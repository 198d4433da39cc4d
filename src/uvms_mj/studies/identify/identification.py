class Identification:
    pass
