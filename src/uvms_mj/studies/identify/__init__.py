"""Identification: coefficients of a vehicle from measurements, by least squares on the plant itself."""

from .identification import Identification as Identification
