"""Solver settings of MuJoCo's contacts: beside scene and plan, they decide the result of a simulated press."""

from __future__ import annotations

from typing import Any

from activetouch.scene import Scene


def solver_settings(scene: Scene) -> dict[str, Any]:
    """What MuJoCo computes the pad's contacts with, read from the compiled model; empty for a press without MuJoCo."""
    model = scene.press_model.compiled(scene.setup, next(iter(scene.solids.values())))
    if model is None:
        return {}
    import mujoco

    kind, pad = ("flex", 0) if model.nflex else ("pair", model.pair("touch").id)
    condim = model.flex_condim if model.nflex else model.pair_dim
    option = model.opt
    return {
        "solver": mujoco.mjtSolver(option.solver).name,
        "cone": mujoco.mjtCone(option.cone).name,
        "integrator": mujoco.mjtIntegrator(option.integrator).name,
        "impratio": float(option.impratio),
        "timestep": float(option.timestep),
        "iterations": int(option.iterations),
        "tolerance": float(option.tolerance),
        "disableflags": int(option.disableflags),
        "enableflags": int(option.enableflags),
        "pad condim": int(condim[pad]),
        **{f"pad {name}": getattr(model, f"{kind}_{name}")[pad].tolist() for name in ("solref", "solimp")},
        **{f"pad {name}": float(getattr(model, f"{kind}_{name}")[pad]) for name in ("margin", "gap")},
    }
