"""Readers whose network computes in fewer bits."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from activetouch.extras import require_extra
from activetouch.perception.reader import TactileReader

PRECISIONS = ("float32", "int8")
"""Numbers that a reader's network computes with; its file holds weights of 16 bits in any case."""


def in_precision(reader: TactileReader, precision: str) -> TactileReader:
    """The reader whose network computes in one of :data:`PRECISIONS`; int8 is ONNX Runtime's dynamic quantisation."""
    if precision == PRECISIONS[0]:
        return reader
    require_extra("train")
    import onnx
    from onnxruntime.quantization import QuantType, quant_pre_process, quantize_dynamic

    with tempfile.TemporaryDirectory() as folder:
        given, prepared, made = (Path(folder) / f"{name}.onnx" for name in ("given", "prepared", "made"))
        given.write_bytes(reader.network)
        quant_pre_process(given, prepared, skip_symbolic_shape=True)
        graph = onnx.load(prepared)
        del graph.graph.value_info[:]  # shapes from before the nodes were fused
        onnx.save(graph, prepared)
        quantize_dynamic(prepared, made, weight_type=QuantType.QUInt8)
        return replace(reader, network=made.read_bytes())
