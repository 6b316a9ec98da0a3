"""Many runs: comparison, equal effort, severe manoeuvres; and a recorded drive."""
