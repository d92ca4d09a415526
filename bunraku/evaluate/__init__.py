"""Measure: tables, baselines, reports, pictures, and a depth camera that errs as real ones do."""
