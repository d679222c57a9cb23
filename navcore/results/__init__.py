"""What a run leaves behind: its figures and its folder."""

from navcore.results.folder import StoredRun, check_free, read_run, write_run
from navcore.results.summary import summarise

__all__ = ["StoredRun", "check_free", "read_run", "summarise", "write_run"]
