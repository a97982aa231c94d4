"""Writes the table of the reflectance model's directional integrals that the package bundles.

    python tools/make_brdf_table.py        # rewrites src/lightprobe/assets/brdf_integrals.safetensors, a second

`lightprobe.render.brdf` says what they are, integrates them and looks them up. Same machine, same table.
"""

from lightprobe.core.checkpoint import save_tensors
from lightprobe.render.brdf import TABLE, integrals


def main() -> None:
    """Integrate and write."""
    save_tensors(TABLE, {"integrals": integrals()})
    print(f"Table: {TABLE}")


if __name__ == "__main__":
    main()
