"""Mutation testing: changed copies of modules, and the tests that notice."""
