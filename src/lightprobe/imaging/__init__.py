"""Image files in, linear float pixels out, and back; sizes are checked before anything is decoded."""
