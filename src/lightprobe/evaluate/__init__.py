"""Predictions and photos in, metrics, tables and the report out."""
