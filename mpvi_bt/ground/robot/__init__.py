"""Robots: their protocol, models and motions."""
