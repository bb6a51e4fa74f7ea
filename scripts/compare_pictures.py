#!/usr/bin/env python3
"""Compares the pictures of two folders that scripts/adapter_pictures.sh wrote, by file name.

    scripts/compare_pictures.py FOLDER OTHER

Colour: mean and 99.9th percentile of the difference, of 255. Depth, classes and instances: share of the pixels that differ
(depth: by more than 1 %), and the same farther than two pixels from an edge of the classes or instances. Wants numpy and Pillow.
"""

import pathlib
import sys

import numpy
from PIL import Image


def away_from_edges(labels):
    """Pixels whose neighbours within two pixels all have the same label."""
    even = numpy.ones(labels.shape, bool)
    for down in range(-2, 3):
        for right in range(-2, 3):
            even &= numpy.roll(labels, (down, right), (0, 1)) == labels
    return even


def pixels(path):
    return numpy.asarray(Image.open(path)).astype(float)


def compare(path, other):
    first, second = pixels(path), pixels(other)
    if first.ndim == 3:
        difference = numpy.abs(first - second)
        return f"mean {difference.mean():.3f}, 99.9 % {numpy.quantile(difference, 0.999):.0f} of 255"
    is_depth = "depth" in path.name
    differs = numpy.abs(first - second) > (0.01 * numpy.maximum(first, second) if is_depth else 0)
    labels = path.with_name(path.name.replace("depth", "semantic"))
    even = away_from_edges(pixels(labels)) & away_from_edges(pixels(other.with_name(labels.name)))
    return f"{100 * differs.mean():.3f} % differ, {100 * differs[even].mean():.3f} % away from edges"


def main():
    first, second = map(pathlib.Path, sys.argv[1:3])
    paths = sorted(first.rglob("*.png"))
    for path in paths:
        name = path.relative_to(first)
        print(f"{name}: {compare(path, second / name)}")
    if not paths:
        sys.exit(f"{first} has no pictures")


if __name__ == "__main__":
    main()
