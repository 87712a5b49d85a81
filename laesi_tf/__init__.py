"""Leaf area in cm2 from one photo on millimetre paper, after LAESI (Kałużny et al., CVPR Workshops 2024)."""
