"""Does the planner find plans that exist?  Problems by seed, each with a known plan or a proof that there is none."""
