"""Drawing with a Vulkan driver, through Taichi's GGUI, in a process of its own.

A driver that crashes takes its process along, and no more. The parent writes positions into memory that both see
(``shared``), and gets pictures back the same way (``renderer``), or what was done with the mouse in a window
(``window``); requests and answers are short messages over pipes (``process``, ``messages``, ``child``).
"""
