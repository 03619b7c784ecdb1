// A peer in Fast DDS that takes commands: a line of its input is one, a line of its output an event.
//
//   writer TOPIC TYPE        publishes TOPIC, reliably           matched TOPIC N   N peers are matched now
//   reader TOPIC TYPE        subscribes to TOPIC, reliably       heard TOPIC HEX   a payload came
//   write TOPIC HEX          publishes these bytes
//
// A payload is all there is of it, encapsulation included, so its byte order and its faults are the caller's.

#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <functional>
#include <iostream>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;
using Bytes = std::vector<unsigned char>;

static void tell(const std::string& line) {
  static std::mutex turn;
  std::lock_guard<std::mutex> guard(turn);
  std::cout << line << std::endl;
}

static std::string hex(const Bytes& bytes) {
  static const char* digits = "0123456789abcdef";
  std::string text;
  for (unsigned char byte : bytes) {
    text += digits[byte >> 4];
    text += digits[byte & 15];
  }
  return text;
}

static Bytes bytes(const std::string& hex) {
  Bytes made;
  for (size_t i = 0; i + 1 < hex.size(); i += 2) made.push_back(std::stoi(hex.substr(i, 2), nullptr, 16));
  return made;
}

// A type of any name whose samples are bytes.
class Raw : public TopicDataType {
 public:
  explicit Raw(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 65536;
    m_isGetKeyDefined = false;
    auto_fill_type_information(false);
    auto_fill_type_object(false);
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const Bytes& bytes = *static_cast<Bytes*>(data);
    payload->length = bytes.size();
    payload->encapsulation = bytes.size() > 1 && bytes[1] == 0 ? CDR_BE : CDR_LE;
    std::memcpy(payload->data, bytes.data(), bytes.size());
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

struct Tells : DataWriterListener, DataReaderListener {
  std::string topic;
  explicit Tells(std::string topic) : topic(std::move(topic)) {}
  void on_publication_matched(DataWriter*, const PublicationMatchedStatus& status) override {
    tell("matched " + topic + " " + std::to_string(status.current_count));
  }
  void on_subscription_matched(DataReader*, const SubscriptionMatchedStatus& status) override {
    tell("matched " + topic + " " + std::to_string(status.current_count));
  }
  void on_data_available(DataReader* reader) override {
    Bytes data;
    SampleInfo info;
    while (reader->take_next_sample(&data, &info) == ReturnCode_t::RETCODE_OK) {
      if (info.valid_data) tell("heard " + topic + " " + hex(data));
    }
  }
};

// UDP on the loopback and nothing else: no multicast, no shared memory.
static DomainParticipantQos loopback() {
  DomainParticipantQos qos;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  udp->maxInitialPeersRange = 12;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  Locator_t peer;
  peer.kind = LOCATOR_KIND_UDPv4;
  IPLocator::setIPv4(peer, "127.0.0.1");
  qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  qos.wire_protocol().builtin.discovery_config.leaseDuration = {3, 0};
  qos.wire_protocol().builtin.discovery_config.leaseDuration_announcementperiod = {1, 0};
  return qos;
}

int main() {
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  auto* factory = DomainParticipantFactory::get_instance();
  auto* participant = factory->create_participant(domain ? std::stoi(domain) : 0, loopback());
  if (!participant) return std::cerr << "no participant" << std::endl, 1;
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  std::map<std::string, DataWriter*> writers;
  std::string line;
  while (std::getline(std::cin, line)) {
    std::istringstream words(line);
    std::string command, topic, rest;
    words >> command >> topic >> rest;
    if (command == "write") {
      Bytes payload = bytes(rest);
      writers.at(topic)->write(&payload);
      continue;
    }
    TypeSupport type(new Raw(rest));
    type.register_type(participant);
    // The topics of services have prefixes of their own, and no slash before them.
    auto* made = participant->create_topic((topic[0] == '/' ? "rt" : "") + topic, rest, TOPIC_QOS_DEFAULT);
    if (command == "writer") {
      DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
      qos.endpoint().history_memory_policy = DYNAMIC_REUSABLE_MEMORY_MODE;
      qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
      qos.durability().kind = VOLATILE_DURABILITY_QOS;
      qos.history().depth = 100;
      writers[topic] = publisher->create_datawriter(made, qos, new Tells(topic));
    } else if (command == "reader") {
      DataReaderQos qos = DATAREADER_QOS_DEFAULT;
      qos.endpoint().history_memory_policy = DYNAMIC_REUSABLE_MEMORY_MODE;
      qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
      qos.history().depth = 100;
      subscriber->create_datareader(made, qos, new Tells(topic));
    } else {
      return std::cerr << "no such command: " << line << std::endl, 1;
    }
  }
  // The process closes everything that is open: the end of the input is the end of the peer.
  participant->delete_contained_entities();
  factory->delete_participant(participant);
}
