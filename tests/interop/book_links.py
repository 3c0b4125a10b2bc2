#!/usr/bin/env python3
"""Refuses a book whose pages link to files that are not there.

    book_links.py FOLDER
"""

import re
import sys
from pathlib import Path

missing = set()
pages = list(Path(sys.argv[1]).glob("*.html"))
for page in pages:
    for link in re.findall(r'(?:href|src)="([^"#]+)', page.read_text()):
        if "://" not in link and not link.startswith(("data:", "mailto:")) and not (page.parent / link).exists():
            missing.add(f"{page.name}: {link}")
if missing or len(pages) < 20:
    sys.exit("\n".join([f"{len(pages)} pages", *sorted(missing)]))
print(f"book: {len(pages)} pages, every link leads to a file")
