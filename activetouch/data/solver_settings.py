"""What MuJoCo computes the pad's contacts with: beyond scene and plan, it decides what a stepped press comes to."""

from __future__ import annotations

from typing import Any

from activetouch.pressing.deformable import Deformable
from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.guarded_move import GuardedMove
from activetouch.scene import Scene


def contact_model(scene: Scene) -> dict[str, Any]:
    """What MuJoCo computes the pad's contacts with, read from the compiled model; empty where it computes none."""
    shape, press = next(iter(scene.shapes.values())), scene.press_model
    if isinstance(press, Dynamic | GuardedMove):
        from activetouch.pressing.rig import build_spec  # loads MuJoCo

        model = build_spec(scene.stage, shape, press.timestep).compile()
        pad, kind, condim = model.pair("touch").id, "pair", model.pair_dim
    elif isinstance(press, Deformable):
        from activetouch.pressing.soft_rig import build_soft_spec  # loads MuJoCo

        model = build_soft_spec(press, scene.pad, shape).compile()
        pad, kind, condim = 0, "flex", model.flex_condim
    else:
        return {}
    import mujoco

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
