"""The campaign against the proof of systems that an ODE defines: random systems, plans and members."""
