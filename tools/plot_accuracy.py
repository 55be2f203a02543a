#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Plots the table of `ubs-lab accuracy`, error against time, with matplotlib.

  ubs-lab accuracy --out accuracy
  tools/plot_accuracy.py accuracy/accuracy.csv accuracy.png

The left plot shows the error of the image against the time of the forward pass. The right plot shows the error of the
gradient (of the parameter group with the largest error) against the time of an iteration. Each configuration has its
own colour, and each pair of scene and device its own marker.
"""
import csv
import sys

try:
    import matplotlib
except ImportError:
    print("SKIPPED: matplotlib is not installed (python3-matplotlib)")
    sys.exit(77)
matplotlib.use("Agg")
import matplotlib.pyplot as plt


def points(rows, stage):
    """Returns {(form, scene, device): (ms, error)} with the largest error of the stage's quantities."""
    found = {}
    for row in rows:
        if row["stage"] != stage:
            continue
        key = row["form"], row["scene"], row["device"]
        error = float(row["typical_error"])
        if key not in found or error > found[key][1]:
            found[key] = float(row["median_ms"]), error
    return found


def main(table, picture):
    with open(table, newline="") as file:
        rows = list(csv.DictReader(file))
    forms = list(dict.fromkeys(row["form"] for row in rows))
    places = list(dict.fromkeys((row["scene"], row["device"]) for row in rows))
    colours, markers = plt.get_cmap("tab20").colors, "osD^v<>PX*"
    figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
    for axis, stage, of in zip(axes, ("forward", "iteration"), ("image", "gradient")):
        for (form, scene, device), (ms, error) in points(rows, stage).items():
            axis.scatter(ms, error, color=colours[forms.index(form) % len(colours)],
                         marker=markers[places.index((scene, device)) % len(markers)])
        axis.set(xscale="log", yscale="log", title=stage, xlabel="time [ms]", ylabel=f"relative error of the {of}")
        axis.grid(alpha=0.3)
    labels = [(f, colours[i % len(colours)], "s") for i, f in enumerate(forms)]
    labels += [(f"{s}, {d[:40]}", "black", markers[i % len(markers)]) for i, (s, d) in enumerate(places)]
    axes[1].legend([plt.Line2D([], [], color=c, marker=m, linestyle="") for _, c, m in labels],
                   [text for text, _, _ in labels], loc="upper left", bbox_to_anchor=(1.02, 1), fontsize="small")
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
