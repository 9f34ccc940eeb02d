"""A page in the browser that plays a system: the engine computes, the page draws and asks for changes."""

from aimd_des.live.html_page import export_page, write_page
from aimd_des.live.server import check_server, serve
from aimd_des.live.settings import default_scenario

__all__ = ["check_server", "default_scenario", "export_page", "serve", "write_page"]
