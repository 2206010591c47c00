"""Pages, tables and figures that all reports share."""
