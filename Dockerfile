# A bare Debian with the framework set up as README's first command does it.
#     docker build --tag mpvi_bt .
#     docker run --rm mpvi_bt                                      what the machine can do
#     docker run --rm --volume "$PWD/runs:/data/runs" mpvi_bt mpvi run picking_up_trash
FROM debian:12-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates make python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/mpvi_bt
COPY . .
RUN make setup && rm -rf /var/lib/apt/lists/* /root/.cache
ENV PATH=/opt/mpvi_bt/.venv/bin:$PATH
WORKDIR /data
CMD ["mpvi", "doctor"]
