/* SPDX-FileCopyrightText: The kitti_ros2 authors
   SPDX-License-Identifier: Apache-2.0

   The theme wraps tables and code after the page is loaded: what scrolls gets the keyboard, and
   the many boxes of buttons are not landmarks. */
function mend() {
  for (const box of document.querySelectorAll('.md-typeset__scrollwrap, pre > code'))
    if (box.tabIndex < 0) {
      box.tabIndex = 0
      box.setAttribute('role', 'group')
      box.setAttribute('aria-label', box.matches('code') ? 'Code' : 'Table')
    }
  for (const box of document.querySelectorAll('.md-code__nav:not([role])'))
    box.setAttribute('role', 'none')
}
new MutationObserver(mend).observe(document.body, {childList: true, subtree: true})
mend()
