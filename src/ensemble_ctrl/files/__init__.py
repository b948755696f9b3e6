"""What is read from files and written to them: problem files, maps, saved plans, results folders, exports."""
