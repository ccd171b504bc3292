"""Plans the experiment that separates what a diagnosis leaves open."""
