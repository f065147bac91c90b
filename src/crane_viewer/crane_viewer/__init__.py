"""The crane and its signals in a browser, live from topics or from a bag; it only looks."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_viewer.scene import ground_arc as ground_arc
    from crane_viewer.scene import reached_places as reached_places
    from crane_viewer.scene import side_outline as side_outline
    from crane_viewer.view import View as View

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
