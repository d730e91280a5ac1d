"""Run time beside error, measured against named rivals and earlier versions in one run."""
