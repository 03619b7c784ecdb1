"""Certificates of a test: one CA, and for whom it signs."""

import os
import subprocess

from bench import Skipped

KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout")
DAY_S = 24 * 3600


class Ca:
    """`ca.pem`, and for each whom it signs for `WHO.pem` and `WHO.key`, in one folder. With the library of a clock that can be
    moved, all begin to hold ten days ago."""

    def __init__(self, folder, clock=None):
        self.folder, self.environment = folder, None
        if clock:
            (folder / "ago").write_text(str(-10 * DAY_S))
            self.environment = os.environ | {"LD_PRELOAD": clock, "CLOCK_OFFSET": str(folder / "ago")}
        self.runs("req", "-x509", *KEY, "ca.key", "-out", "ca.pem", "-subj", "/CN=ca", "-days", "20")

    def signs(self, who, name, days=20):
        """For `who`, found by `name`."""
        (self.folder / "names").write_text(f"subjectAltName=DNS:{name}\n")
        self.runs("req", *KEY, f"{who}.key", "-out", f"{who}.csr", "-subj", f"/CN={who}")
        self.runs("x509", "-req", "-in", f"{who}.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-out", f"{who}.pem",
                  "-days", str(days), "-extfile", "names")

    def runs(self, *words):
        try:
            subprocess.run(["openssl", *words], cwd=self.folder, env=self.environment, check=True, capture_output=True)
        except FileNotFoundError:
            raise Skipped("no openssl") from None
