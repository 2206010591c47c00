"""Evidence of finished slices of a bank of bodies in files, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

import numpy as np

from activetouch.scene_description import scene_fields
from belief.files import atomic_path, read_npz, require_regular_file
from experiments.bayes_error.body_bank import BodyBank
from experiments.bayes_error.joint_evidence import Evidence
from experiments.bayes_error.touched_objects import TouchedObjects
from experiments.search.fingerprint import fingerprint, made_with


def kept(folder: Path, bank: BodyBank, touched: TouchedObjects, shape: int, number: int) -> tuple[int, int, Evidence]:
    """:meth:`BodyBank.evidence`, from its file if there is one; else it is computed and written.

    Args:
        folder: of the files; their names hold a digest of the bank, of the touches, and of the code that computes.
        bank: of bodies.
        touched: the objects.
        shape: index of the shape.
        number: of the slice.
    """
    numbers = f"{bank.draws} {bank.force_ratios} {bank.seed} {bank.slice_size} {shape} {number}"
    code = f"{fingerprint(bank.scene)} {made_with()}"
    identity = f"{scene_fields(bank.scene)} {touched.digest} {numbers} {code}"
    path = folder / f"{hashlib.sha256(identity.encode()).hexdigest()[:32]}.npz"
    try:
        content = require_regular_file(path).read_bytes()
        return shape, number, Evidence(**read_npz(content, len(content), ["joint", "single"]))
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):  # not there, or damaged: computed again
        pass
    *_, evidence = bank.evidence(touched, shape, number)
    with atomic_path(path) as temporary:
        np.savez(temporary, joint=evidence.joint, single=evidence.single)
    return shape, number, evidence
