"""One self-contained HTML page about a run or a study, which works without a network."""

from aimd_des.report.html_page import check_page, write_page
from aimd_des.report.run_page import report_run
from aimd_des.report.study_page import report_study

__all__ = ["check_page", "report_run", "report_study", "write_page"]
