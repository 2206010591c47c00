"""Sensors of described pads, made without training of the shipped reader of any pad.

>>> from activetouch import PadDescription, Taxels
>>> reader_of_pad(PadDescription(Taxels.grid(14, 6, 0.0034), is_relative=True)).card.image_shape
(32, 32)
"""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import replace
from pathlib import Path

from activetouch.errors import SceneShift
from activetouch.pad_file import PadDescription, read_pad
from activetouch.perception.cached_arrays import cache_folder
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.described_pads import responses_beyond
from activetouch.perception.imaging import imaging_of_pad
from activetouch.perception.reader import TactileReader
from activetouch.scene_description import scene_fields
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS, PAD_FILE, shipped_file

READER = MODELS / "any_pad.safetensors"
"""The shipped reader."""


def reader_of_pad(pad: PadDescription) -> TactileReader:
    """The shipped reader, told about a pad; a warning where the pad's response goes beyond the training."""
    if beyond := responses_beyond(pad):
        warnings.warn(
            f"the reader of any pad was trained with other responses than this description allows: {beyond}. It may "
            "read this pad less well than it states",
            SceneShift,
            stacklevel=2,
        )
    reader, imaging = TactileReader.load(shipped_file(READER)), imaging_of_pad(pad)
    assert isinstance(reader.hypotheses, ContactHypotheses), "it reads any object"
    card = replace(reader.card, scene=scene_fields(pad.scene()), imaging=imaging.fields())
    return replace(reader, card=card, hypotheses=replace(reader.hypotheses, imaging=imaging))


def sensor_of_pad(pad: PadDescription | str | Path) -> Path:
    """The folder of a sensor for a pad or the file of its description, made without training, in the cache.

    >>> from activetouch import Taxels, TactileSensor
    >>> pad = PadDescription(Taxels.grid(4, 4, 0.005))
    >>> folder = sensor_of_pad(pad)  # doctest: +SKIP
    >>> sensor = TactileSensor.load(folder, pad.scene())  # doctest: +SKIP
    """
    pad = pad if isinstance(pad, PadDescription) else read_pad(pad)
    reader = reader_of_pad(pad)
    assert isinstance(reader.hypotheses, ContactHypotheses), "it reads any object"
    of_all = hashlib.sha256(f"{reader.digest} {reader.hypotheses.digest}".encode())  # the network, and the description
    folder = cache_folder() / "pads" / of_all.hexdigest()[:32]
    if not (folder / ANY_OBJECT_FILE).is_file():
        folder.mkdir(parents=True, exist_ok=True)
        pad.save(folder / PAD_FILE)
        reader.save(folder / ANY_OBJECT_FILE)
    return folder
