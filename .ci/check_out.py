"""Fails unless the given result folder holds a solved plan with its pictures and page."""

import json
import re
import sys
from pathlib import Path

import numpy as np

out = Path(sys.argv[1])
plan = json.loads((out / "plan.json").read_text(encoding="utf-8"))
assert plan["status"] == "solved", plan["status"]
with np.load(out / "trajectory.npz", allow_pickle=False) as arrays:
    samples = len(arrays["time"])
    for name in ("q", "v", "a", "tau", "tau_rate", "object_position", "internal_force"):
        assert len(arrays[name]) == samples, f"{name} has {len(arrays[name])} rows, not {samples}"
        assert np.isfinite(arrays[name]).all(), f"{name} is not finite"
assert (out / "plots.png").read_bytes().startswith(b"\x89PNG"), "plots.png is no PNG"
page = (out / "motion.html").read_text(encoding="utf-8")
outside = re.findall(
    r"<(?:script|link|img)\b[^>]*?\b(?:src|href)=[\"']?(?:https?:)?//[^\s>]*", page
)
assert not outside, f"motion.html loads from the network: {outside[:3]}"
print(f"{out}: cost {plan['cost']:.6f}, {samples} samples, page of {len(page) / 1e6:.1f} MB")
