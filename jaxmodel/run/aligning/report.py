"""Tables, figures and report of the experiment ``multiview``."""

from collections.abc import Mapping
from typing import Any

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import kept
from jaxmodel.run.provenance import facts
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.charts import Chart, Panel, Picture, Series
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table
from jaxmodel.view.view_graph_figure import GraphLine, view_graph_png


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The views; more than one order beside each other; the cycles."""
    several = len(summary["orders"]) > 1
    shown = [_views(summary, "" if several else f" | {command}")]
    if any(order.get("cycles") for order in summary["orders"]):
        shown.append(_cycles(summary))
    return [*shown, _orders(summary, command)] if several else shown


def _views(summary: Mapping[str, Any], after: str) -> Table:
    known = any("turn_deg" in view for view in summary["views"])
    columns = ["view", "placed", "standard deviation: turn in degrees, shift"] + (
        ["error: degrees, shift"] if known else []
    )
    rows = []
    for view in summary["views"]:
        row = [view["name"], "yes" if view["placed"] else "no: no pair of it is believed"]
        row.append(f"{view['deviation_deg']:.3f}, {view['deviation']:.2g}" if "deviation" in view else "")
        if known:
            row.append(f"{view['turn_deg']:.3f}, {view['shift']:.3g}" if "turn_deg" in view else "")
        rows.append(row)
    return Table(f"Views in one frame{after}", columns, rows)


def _cycles(summary: Mapping[str, Any]) -> Table:
    rows = [
        (
            order["name"].replace("_", " "),
            ", ".join(cycle["views"]),
            "{:.3f}, {:.3f}".format(*cycle["opening_deg"]),
            "{:.3g}, {:.3g}".format(*cycle["opening"]),
        )
        for order in summary["orders"]
        for cycle in order.get("cycles", [])
    ]
    columns = ("order", "cycle", "opening before, after (degrees)", "opening before, after")
    return Table("Cycles of three, corrected by each other (§2.8)", columns, rows)


def _orders(summary: Mapping[str, Any], command: str) -> Table:
    known = "turn_median" in summary["orders"][0]
    columns = ["order", "views", "apart: as fused, all at once"]
    columns += ["error as fused: median, worst (degrees; shift)", "all at once: median, worst"] if known else []
    rows = []
    for order in summary["orders"]:
        row = [
            order["name"].replace("_", " "),
            str(order["views"]),
            f"{order['apart_first']:.3g}, {order['apart']:.3g}",
        ]
        if known:
            for after in ("_first", ""):
                turn = f"{order['turn_median' + after]:.3f}, {order['turn_worst' + after]:.3f}"
                row.append(f"{turn}; {order['shift_median' + after]:.3g}, {order['shift_worst' + after]:.3g}")
        rows.append([*row, f"{order['seconds']:.1f}, {order['joint_seconds']:.1f}"])
    columns.append("seconds: fusion, all at once")
    title = "Orders of fusion (§2.8, Table 5.3); apart: median distance to tangent planes"
    return Table(f"{title} | {command}", columns, rows)


def charts(summary: Mapping[str, Any]) -> list[Chart]:
    """The orders beside each other, where there are several; none else."""
    orders = summary["orders"]
    if len(orders) < 2:
        return []
    names = [order["name"].replace("_", " ") for order in orders]

    def panel(title: str, label: str, key: str) -> Panel:
        first, last = ([order[key + after] for order in orders] for after in ("_first", ""))
        return Panel(title, "order", label, [Series("as fused", names, first, style="bars"),
                                             Series("all at once", names, last, style="bars")])  # fmt: skip

    panels = [panel("how far views are apart", "median distance to tangent planes, unit of the data", "apart")]
    if "turn_median" in orders[0]:
        panels += [
            panel("turn", "median error, degrees", "turn_median"),
            panel("shift", "median error", "shift_median"),
        ]
    return [Chart("orders", "Orders of fusion", panels)]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    manifest = folder.read_json("manifest.json")
    cloud = kept(folder, "merged")["cloud"]
    merged = mesh_png(
        [MeshPanel("all views, a colour each", *cloud), MeshPanel("from behind", *cloud, azimuth_deg=120.0)]
    )
    graph = view_graph_png([view["name"] for view in summary["views"]], _lines(summary))
    pictures = {"merged": ("The merged cloud", merged), "graph": ("Views and what they share (Fig. 2.26)", graph)}
    drawn = charts(summary)
    for name, png in [(name, png) for name, (_, png) in pictures.items()] + [(c.name, chart_png(c)) for c in drawn]:
        folder.write(f"figures/{name}.png", png)
    sections = [*(Picture(title, png) for title, png in pictures.values()), *drawn]
    shown = [*tables(summary, manifest["command"]), _pairs(summary)]
    page = render_report("Whole sets of views (thesis §2.8, §5.4.3)", facts(manifest), shown, sections)
    folder.write("report.html", page.encode())
    return [f"figures/{name}.png" for name in (*pictures, *(chart.name for chart in drawn))]


def _lines(summary: Mapping[str, Any]) -> list[GraphLine]:
    number = {view["name"]: k for k, view in enumerate(summary["views"])}
    return [
        GraphLine(
            number[pair["target"]],
            number[pair["source"]],
            min(pair["overlap_target"], pair["overlap_source"]),
            "doubtful" if pair["doubtful"] else "common" if pair["common"] else "joined",
        )
        for pair in summary["pairs"]
        if pair["joined"]
    ]


def _pairs(summary: Mapping[str, Any]) -> Table:
    rows = [
        (
            f"{pair['target']}, {pair['source']}",
            pair["outcome"].replace("_", " "),
            f"{pair['probability']:.3f}",
            f"{100 * pair['overlap_target']:.0f}, {100 * pair['overlap_source']:.0f} %",
            "doubtful" if pair["doubtful"] else "tree" if pair["tree"] else "yes" if pair["joined"] else "no",
        )
        for pair in summary["pairs"]
    ]
    return Table("Pairs", ("target, source", "outcome", "probability", "shared", "joins"), rows)
