"""PyTorch's vector functions are settled before anything of ours computes."""

import grimp

SETTLED = "lightprobe.core.first_calls"


def test_every_module_that_computes_calls_them_once_on_import():
    imports = grimp.build_graph("lightprobe", include_external_packages=True)

    def settles(module: str) -> bool:
        loaded = [
            module.rsplit(".", depth)[0] for depth in range(module.count("."))
        ]  # itself and its packages
        return any(imports.chain_exists(importer=one, imported=SETTLED) for one in loaded)

    computing = imports.find_modules_that_directly_import("torch")
    above = [module for module in computing if not module.startswith("lightprobe.core.")]
    assert len(above) > 50
    assert [module for module in sorted(above) if not settles(module)] == []
