# docker build -t penode . && docker run --rm -v "$PWD:/data" penode identify run.csv --out result
FROM python:3.13-slim AS build
WORKDIR /source
COPY . .
RUN pip install --no-cache-dir build && python -m build --wheel --outdir /wheel

FROM python:3.13-slim
# A compiler, as the kernels are compiled at first use and an identification takes twice as long without.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends gcc libc6-dev \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /wheel /wheel
COPY constraints.txt /wheel/
RUN pip install --no-cache-dir -c /wheel/constraints.txt \
    "$(ls /wheel/*.whl)[all]" \
    && useradd --create-home penode
USER penode
WORKDIR /data
ENTRYPOINT ["penode"]
CMD ["--help"]
