"""Recordings and the windows that are simulated of them."""
