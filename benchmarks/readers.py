"""Measure the time to read a touch in torch (as it is, and compiled) and in ONNX Runtime. One process, one thread.

Run: python benchmarks/readers.py [BACKBONE ...]        # cnn, atto and tiny by default; needs the extra `train`

Random weights, images of 64 × 64 pixels. Medians of interleaved rounds, and the ratio to torch within a round.
``activetouch frontier`` measures trained networks, with their accuracy.
"""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
import torch
from rounds import time_in_rounds

from activetouch.perception.card import ClassifierCard
from activetouch.perception.classifier import TouchClassifier, TouchNetwork
from experiments.sensor.frontier import runtimes

ROUNDS, PER_ROUND, BATCHES, EDGE = 9, 3, (1, 64), 64


def main(backbones: list[str]) -> None:
    torch.set_num_threads(1)
    images = np.random.default_rng(0).integers(0, 255, (max(BATCHES), EDGE, EDGE)).astype(np.uint8)
    for backbone in backbones:
        card = ClassifierCard(backbone, EDGE, ("a", "b", "c", "d"), ("p",))
        found = runtimes(TouchClassifier(card, TouchNetwork(card)), (EDGE, EDGE))
        readers = {name: reader for name, reader in found if name in ("torch", "torch, compiled", "ONNX Runtime")}
        for batch in BATCHES:
            cases = {name: partial(_read, reader, images[:batch]) for name, reader in readers.items()}
            milliseconds = time_in_rounds(cases, ROUNDS, PER_ROUND)
            for name, times in milliseconds.items():
                ratio = float(np.median(times / milliseconds["torch"]))
                print(
                    f"{backbone:<5} batch {batch:<3} {name:<16} {np.median(times) / batch:8.3f} ms ({ratio:.2f})",
                    flush=True,
                )


def _read(reader, images, index: int) -> None:
    reader.read(images, len(images))


if __name__ == "__main__":
    main(sys.argv[1:] or ["cnn", "atto", "tiny"])
