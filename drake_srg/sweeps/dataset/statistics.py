"""Computes statistics of a data set's features, in LeRobot's layout.

For each feature and dimension: min, max, mean, std, count and the quantiles q01, q10,
q50, q90 and q99. For images, they are per color channel, with values from 0 to 1, shape
(3, 1, 1). LeRobot estimates them from samples; here they cover all values.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pyarrow as pa

from drake_srg.sweeps.dataset.recording import Image

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
STATISTICS = ("min", "max", "mean", "std", "count", *QUANTILES)

Statistics = dict[str, Any]  # name to nested lists of numbers, for JSON and Parquet


def column_statistics(column: pa.ChunkedArray | pa.Array) -> Statistics:
    """Return the statistics of a Parquet column of numbers or of vectors."""
    if pa.types.is_fixed_size_list(column.type):
        size = column.type.list_size
        values = column.combine_chunks().flatten().to_numpy().reshape(-1, size)
    else:
        values = column.to_numpy(zero_copy_only=False).reshape(-1, 1)
    numbers = values.astype(np.float64)
    statistics = {
        "min": values.min(axis=0),  # min and max keep the feature's type
        "max": values.max(axis=0),
        "mean": numbers.mean(axis=0),
        "std": numbers.std(axis=0),
        "count": np.array([len(values)]),
        **{name: np.quantile(numbers, q, axis=0) for name, q in QUANTILES.items()},
    }
    return {name: value.tolist() for name, value in statistics.items()}


class ImageStatistics:
    """Exact statistics of images in constant memory: counts how often values occur."""

    def __init__(self) -> None:
        self._histogram = np.zeros((3, 256), dtype=np.int64)
        self._images = 0

    def add(self, image: Image) -> None:
        """Count the values of an image, shape (height, width, 3)."""
        for channel in range(3):
            counts = cv2.calcHist([image], [channel], None, [256], [0, 256])
            self._histogram[channel] += counts.ravel().astype(np.int64)
        self._images += 1

    def merge(self, other: ImageStatistics) -> None:
        """Add the counts of another instance."""
        self._histogram += other._histogram
        self._images += other._images

    def statistics(self) -> Statistics:
        """Return the statistics; needs at least one image."""
        value = np.arange(256) / 255.0
        channels = [_weighted(value, counts) for counts in self._histogram]
        shaped = {
            name: np.reshape(
                [channel[name] for channel in channels], (3, 1, 1)
            ).tolist()
            for name in channels[0]
        }
        return {**shaped, "count": [self._images]}


def _weighted(
    value: npt.NDArray[np.float64], counts: npt.NDArray[np.int64]
) -> dict[str, float]:
    """Return the statistics of values, given how often each occurs."""
    mean = np.average(value, weights=counts)
    seen = value[counts > 0]
    quantiles = np.quantile(
        value, [*QUANTILES.values()], weights=counts, method="inverted_cdf"
    )
    return {
        "min": seen[0],
        "max": seen[-1],
        "mean": mean,
        "std": np.sqrt(np.average((value - mean) ** 2, weights=counts)),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }
