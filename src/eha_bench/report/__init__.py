"""Reports of a run for people and machines: HTML, JUnit, Markdown. Shows results, computes none."""

from eha_bench.report.junit import write_junit
from eha_bench.report.markdown import append_step_summary, markdown_summary
from eha_bench.report.run_report import write_report

__all__ = ["append_step_summary", "markdown_summary", "write_junit", "write_report"]
