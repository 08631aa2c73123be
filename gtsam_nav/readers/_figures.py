"""Noise figures that a card states of sensors whose file holds no sigmas."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

Figures = Mapping[str, Mapping[str, Any]]
"""What a card states under ``noise``, by the sensor's name."""

NO_FIGURES: Figures = MappingProxyType({})
