"""backlash: find play (dead band) in control valves from historian exports.

    from backlash_cli import read, scan, to_dataframe

    plant = read(["plant.csv"])
    result = scan(plant)
    print(to_dataframe(result))"""

import lazy_loader

# what stands in __init__.pyi is imported when it is asked for: `backlash --help` needs none of it
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
