"""The survey as one HTML page that needs no other file."""

from pathlib import Path

from experiments.study.page import named_versions, rendered
from experiments.study.provenance import commit
from experiments.study.results import Results


def write_page(found: Results, folder: Path) -> None:
    """Write `survey.html` into a folder that has the figures and recordings already."""
    summary = found.summary
    assumed = summary["assumptions"]
    kind = "model" if "model_sha256" in summary else "matrix"
    origin = {
        "command": summary["command"],
        "checks": found.checked,
        kind: f"SHA-256 of {summary['title']} {summary[f'{kind}_sha256']}",
        "versions": named_versions(summary["versions"]),
        "commit": commit(),
    }
    content = {
        "survey": summary,
        "findings": [said for said in summary["sentences"] if said not in assumed],
        "complaint": found.failed_check,
        "tables": found.tables,
        "pictures": found.pictures,
        "recordings": sorted(file.name for file in folder.glob("*.rrd")),
        "folder": folder,
        "origin": origin,
    }
    html = rendered("experiments.survey", "survey.html.j2", **content)
    (folder / "survey.html").write_text(html, encoding="utf-8")
