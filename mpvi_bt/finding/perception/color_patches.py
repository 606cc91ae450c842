"""Patches of a thing in a picture that have a color of their own: lights on it, things in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

# All our choice.
_LIKE = 12  # neighbors of one face differ by no more in red, green or blue, of 255
_OWN = 0.1  # a face of so much of the thing is its own [ratio]
_LEAST_PX = 8
_MOST = 8  # patches, the largest


def patches(rgb: NDArray[np.uint8], thing: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(H, W) patches within a thing, counted from 1 and the largest first; 0 elsewhere.

    Args:
        rgb: (H, W, 3).
        thing: (H, W) its pixels; holes in it count as patches, too.
    """
    out = np.zeros(thing.shape, np.int32)
    box = ndimage.find_objects(thing.astype(np.uint8), 1)[0] if thing.any() else None
    if box is None:
        return out
    inside = ndimage.binary_fill_holes(thing[box])
    faces = _faces(rgb[box].astype(np.int32), inside)
    rest = inside & (np.bincount(faces.ravel()) < _OWN * np.count_nonzero(inside))[faces]
    parts, count = ndimage.label(ndimage.binary_opening(rest, np.ones((2, 2))))
    area = np.bincount(parts.ravel(), minlength=count + 1)
    area[0] = 0
    number = np.zeros(count + 1, np.int32)
    kept = [k for k in np.argsort(-area, kind="stable")[:_MOST] if area[k] >= _LEAST_PX]
    number[kept] = np.arange(1, len(kept) + 1)
    out[box] = number[parts]
    return out


def _faces(rgb: NDArray[np.int32], inside: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(h, w) connected pixels of like colors, each with one number."""
    at = np.arange(inside.size).reshape(inside.shape)
    pairs = []
    for a, b in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        like = inside[a] & inside[b] & (np.abs(rgb[a] - rgb[b]).max(-1) <= _LIKE)
        pairs.append(np.stack([at[a][like], at[b][like]]))
    i, j = np.concatenate(pairs, 1)
    graph = coo_matrix((np.ones(len(i), bool), (i, j)), shape=(inside.size, inside.size))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp).reshape(inside.shape)
