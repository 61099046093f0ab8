"""Look at a dataset: a page with its samples, overlays and distributions, and a contact sheet.

``scenegate dataset show`` uses it.
"""
