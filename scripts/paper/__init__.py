"""The paper's figures and tables, made with our simulator and resolver; run by scripts/reproduce_paper."""
