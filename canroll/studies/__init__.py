"""Many runs: comparison, equal effort, campaign."""
